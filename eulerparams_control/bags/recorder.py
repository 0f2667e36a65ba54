"""The executable ``bag_recorder``: record topics, or make killed recordings whole."""

import sys

from eulerparams_control.bags.recovery import recover
from eulerparams_control.errors import EulerParamsError

_RECOVER = "--recover"


def main(args: list[str] | None = None) -> int:
    """Run ``bag_recorder [--ros-args ...]`` or ``bag_recorder --recover BAG [BAG ...]``.

    Returns:
        the exit code: 0, or 1 after an error, which is told in one line.
    """
    arguments = sys.argv[1:] if args is None else args
    if arguments[:1] == [_RECOVER]:
        return _recover_all(arguments[1:])
    from eulerparams_control.bags.ros.recorder_node import BagRecorder  # recovery needs no ROS
    from eulerparams_control.ros.runtime import run

    return run(BagRecorder, args)


def _recover_all(folders: list[str]) -> int:
    if not folders:
        print(f"error: usage: bag_recorder {_RECOVER} BAG [BAG ...]", file=sys.stderr)
        return 1
    code = 0
    for folder in folders:
        try:
            print(recover(folder))
        except EulerParamsError as error:
            print(f"error: {error}", file=sys.stderr)
            code = 1
    return code


if __name__ == "__main__":
    sys.exit(main())
