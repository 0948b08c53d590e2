"""Conversion from local east-north-up coordinates to latitude, longitude and height above the WGS 84 ellipsoid."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array

SEMI_MAJOR_M = 6378137.0
"""Semi-major axis of the WGS 84 ellipsoid, metres (NIMA TR8350.2, table 3.1)."""
FLATTENING = 1 / 298.257223563
"""Flattening of the same ellipsoid."""
ECCENTRICITY_2 = FLATTENING * (2 - FLATTENING)
STEPS = 6
"""Fixed-point iterations for the latitude; each gains a factor of 150, so the last step is below 1e-12 rad."""


@dataclass(frozen=True)
class Datum:
    """Geodetic position of the world's origin: degrees, and metres above the ellipsoid."""

    latitude_deg: float
    longitude_deg: float
    height_m: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """Datum from `LAT,LON,HEIGHT`; UserError when the text is invalid."""
        try:
            latitude, longitude, height = (float(word) for word in text.split(","))
        except ValueError:
            latitude = longitude = height = np.nan
        if not (abs(latitude) < 90 and abs(longitude) <= 180 and abs(height) < 1e5):
            raise UserError(f"datum {text!r}: write LAT,LON,HEIGHT in degrees and metres, as 47.3769,8.5417,408")
        return cls(latitude, longitude, height)

    def __str__(self) -> str:
        return f"{self.latitude_deg!r},{self.longitude_deg!r},{self.height_m!r}"

    def geodetic(self, east_north_up_m: Array) -> Array:
        """Latitude and longitude in degrees and height in m (n, 3) of east-north-up points (n, 3), metres."""
        lat, lon = np.radians([self.latitude_deg, self.longitude_deg])
        radius = SEMI_MAJOR_M / np.sqrt(1 - ECCENTRICITY_2 * np.sin(lat) ** 2)
        out = radius + self.height_m
        origin = [out * np.cos(lat) * np.cos(lon), out * np.cos(lat) * np.sin(lon), 0.0]
        origin[2] = (radius * (1 - ECCENTRICITY_2) + self.height_m) * np.sin(lat)
        east = [-np.sin(lon), np.cos(lon), 0.0]
        north = [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)]
        up = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
        x, y, z = (np.array(origin) + east_north_up_m @ np.array([east, north, up])).T
        across = np.hypot(x, y)
        found = np.arctan2(z, across * (1 - ECCENTRICITY_2))
        for _ in range(STEPS):
            radius = SEMI_MAJOR_M / np.sqrt(1 - ECCENTRICITY_2 * np.sin(found) ** 2)
            found = np.arctan2(z + ECCENTRICITY_2 * radius * np.sin(found), across)
        height = across * np.cos(found) + z * np.sin(found) - SEMI_MAJOR_M**2 / radius
        return np.column_stack([np.degrees(found), np.degrees(np.arctan2(y, x)), height])
