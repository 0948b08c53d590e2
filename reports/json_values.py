"""Values as JSON can hold them: numbers that are not finite become null."""

import math
from collections.abc import Mapping
from typing import Any


def json_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """The values by name, None for each number that is not finite."""
    return {name: None if isinstance(v, float) and not math.isfinite(v) else v for name, v in values.items()}
