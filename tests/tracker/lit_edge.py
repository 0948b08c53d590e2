"""Images of a straight edge through a lens, as a camera codes them, and the control points of its border."""

import math

import numpy as np
from scipy.special import erf

from uavbench.scenes.rendering.radiance import encode
from uavbench.tracker.robust.edges.measurements import SearchLines
from uavbench.tracker.robust.optics.response import srgb_light

SIZE, FINE = 61, 8
WHOLE = 6.0
"""Where erf is 1 to the last digit."""
SRGB = srgb_light(np.arange(256) / 255)
DARK, BRIGHT = np.array([0.05, 0.08, 0.12]), np.array([0.5, 0.45, 0.4])
CODES = np.concatenate([encode(DARK[None, None])[0, 0], encode(BRIGHT[None, None])[0, 0]]).astype(float)


def edge(blur_px, angle_deg, distance=0.0, noise=0.0, rng=None, moved_px=(0.0, 0.0, 0.0), bright=BRIGHT):
    """Image of a half plane by a lens, and the control points of its border, `distance` px before it.

    moved_px: by how much each channel is displaced along the normal. bright: light of its bright side, 1 for white.
    """
    nu, nv = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    at = np.arange(SIZE) - SIZE // 2
    across = at[None, :] * nu + at[:, None] * nv
    lens = math.sqrt(max(blur_px**2 - 1 / 12, 1e-9))
    share = np.broadcast_to((across > 0)[..., None], (SIZE, SIZE, 3)).astype(float)
    mixed = np.abs(across) < WHOLE * math.sqrt(2) * lens + np.abs(moved_px).max() + 1  # pixels that see both sides
    within = (np.arange(FINE) + 0.5) / FINE - 0.5
    parts = across[mixed, None] + (within[None, :] * nu + within[:, None] * nv).reshape(1, -1)
    share[mixed] = (0.5 * (1 + erf((parts[..., None] - moved_px) / (math.sqrt(2) * lens)))).mean(axis=1)
    codes = encode(np.minimum(1, DARK * (1 - share) + bright * share)).astype(float)
    codes += rng.normal(0, noise, codes.shape) if rng is not None else 0.0
    along = np.arange(-18, 19, 6)
    n = len(along)
    pixels = np.full((n, 2), SIZE // 2) + along[:, None] * [-nv, nu] - distance * np.array([nu, nv])
    lines = np.column_stack([pixels, np.full(n, nu), np.full(n, nv)])
    return np.clip(np.rint(codes), 0, 255).astype(np.uint8), SearchLines(lines, np.zeros((n, 6)), np.ones(n, np.int64))


def appearance(lines, learned=True):
    """Rows of appearance of the control points, which know both colours."""
    rows = np.zeros((len(lines.lines), 8))
    rows[:, :6], rows[:, 6] = CODES, float(learned)
    return rows
