"""The command `uavbench` as `python -m uavbench`."""

from uavbench.bench.cli.__main__ import main

if __name__ == "__main__":
    main()
