"""`python -m uavbench.bench.cli` is the command `uavbench`."""

from uavbench.bench.cli.main import main

if __name__ == "__main__":
    main()
