"""The one exception that a user's mistake raises."""


class UserError(Exception):
    """A mistake in what the user gave: names the file, key or frame, what is wrong, and what to do.

    The command line prints its message without a traceback and exits with code 2.
    """


def unknown_name(what: str, name: str, valid: list[str]) -> UserError:
    """Error for a name that is not among the valid ones; says the nearest valid name."""
    import difflib

    near = difflib.get_close_matches(name, valid, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return UserError(f"unknown {what} {name!r}{hint} (valid: {', '.join(sorted(valid))})")
