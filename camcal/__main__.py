"""`camcal` and `python -m camcal`: the program's entry, which imports only what its command needs."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line and leave with its exit code."""
    from camcal.system.processes import collect_seldom, end_on_signals, leave, limit_linear_algebra
    from camcal.system.streams import hold_standard_descriptors

    collect_seldom()
    hold_standard_descriptors()
    end_on_signals()
    limit_linear_algebra()
    from camcal.cli.boundary import run

    leave(run(sys.argv[1:]))


if __name__ == "__main__":
    main()
