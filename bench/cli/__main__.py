"""Where the command `uavbench` begins, also as `python -m uavbench.bench.cli`."""

import signal


def main() -> None:
    """Run the command; an interrupt that comes while its modules are imported ends it without a traceback."""
    handler = signal.getsignal(signal.SIGINT)
    if handler is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from uavbench.bench.cli.main import main as command

    signal.signal(signal.SIGINT, handler)
    command()


if __name__ == "__main__":
    main()
