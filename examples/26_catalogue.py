"""Which effects can be named, and how does each look in the data?

    python examples/26_catalogue.py [NAME]

Prints every effect of the catalogue with its formula; with a name, what it looks like and what to
do about it. The same from the shell: tactile-dynamics effects
"""

import sys

from tactile_dynamics_ros.core.effects import create_effect, registered_names


def main(arguments: list[str]) -> None:
    """Print the catalogue, or one effect."""
    for name in arguments or registered_names():
        effect = create_effect(name)
        print(f"{name:18s} {effect.formula}")
        if arguments:
            print(f"{effect.sentence}\nlooks like: {effect.looks_like}\nremedy: {effect.remedy}")


if __name__ == "__main__":
    main(sys.argv[1:])
