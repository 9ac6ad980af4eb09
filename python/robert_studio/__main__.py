"""The command ``robert``, in this process: ``python -m robert_studio rollout fire``."""

import sys

from . import _native


def main() -> None:
    sys.exit(_native.main(["robert", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
