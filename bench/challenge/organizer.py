"""The organizer's record of a challenge: the mapping of public to true sequence names."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from uavbench.bench.challenge.secret import Secret
from uavbench.bench.config.suite import Suite
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.reading import read_json
from uavbench.trajectories.files.writing import write_text

CHALLENGE = "challenge.json"
SECRET = "secret.toml"


@dataclass(frozen=True)
class Hidden:
    """A sequence of the suite: its true name, and the public name of its flight, shared by the flight's seeds."""

    name: str
    flight: str


@dataclass(frozen=True)
class Challenge:
    """A challenge: its identifier, its frame rate in Hz, and its sequences by public name.

    The identifier is derived from the secret, the suite's sequences and all that their ground truth is rendered from,
    so that all packages of a challenge share it, and scores against another ground truth have another one.
    """

    challenge: str
    rate_hz: float
    sequences: Mapping[str, Hidden]

    @classmethod
    def of(cls, suite: Suite, secret: Secret, keys: Iterable[str]) -> "Challenge":
        """The challenge of a suite, with its sequences in an order derived from the secret.

        keys: hashes of all that the sequences are rendered from, the versions of uavbench and of libraries included.
        """
        names = sorted((spec.name for spec in suite.sequences), key=lambda name: secret.derived("order", name))
        flight_of = {spec.name: spec.name.removesuffix(f"-s{spec.seed}") for spec in suite.sequences}
        flights = list(dict.fromkeys(flight_of[name] for name in names))
        width = max(2, len(str(len(names))))
        hidden = {
            f"sequence-{number:0{width}}": Hidden(name, f"flight-{1 + flights.index(flight_of[name])}")
            for number, name in enumerate(names, start=1)
        }
        rate_hz = max(suite.rates_hz)
        what = json.dumps([suite.flights, rate_hz, sorted(names), sorted(keys)])
        return cls(secret.identifier(what), rate_hz, hidden)

    def refuse_other(self, folder: Path) -> None:
        """Raise UserError when an organizer's folder belongs to another challenge."""
        if (folder / CHALLENGE).exists() and self.load(folder).challenge != self.challenge:
            raise UserError(
                f"{folder}: belongs to another challenge, with another secret or other sequences, or rendered by "
                "another version of uavbench, a library or a plug-in, whose submissions could not be scored any more; "
                "pack with those, or name another folder with --truth, for a new package"
            )

    def save(self, folder: Path) -> None:
        """Write the record into the organizer's folder."""
        write_text(folder / CHALLENGE, json.dumps(asdict(self), indent=1) + "\n", kind="flights of a challenge")

    @classmethod
    def load(cls, folder: Path) -> "Challenge":
        """Read the record from the organizer's folder; UserError when it is missing or invalid."""
        path = folder / CHALLENGE
        about = read_json(path, hint="; give the folder that `uavbench pack` called the organizer's")
        about.pop("made_by", None)
        try:
            return TypeAdapter(cls).validate_python(about)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise UserError(f"{path}: {where}: {first['msg']}; pack the suite again") from None
