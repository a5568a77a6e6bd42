"""Each effect alone in its own record: is it the first cause that a diagnosis names? The hardest of `fdbench check`."""

import sys
from time import process_time

from threadpoolctl import threadpool_limits

from fdbench.checks._own_record import is_named_first
from fdbench.checks._report import NotApplicable
from fdbench.effects import effects
from fdbench.errors import PluginError


def main() -> None:
    print("| effect | named first | CPU s |")
    print("| --- | --- | ---: |")
    tried, missed = 0, 0
    for name in sys.argv[1:] or effects.names():
        start, said = process_time(), "yes"
        try:
            with threadpool_limits(1):
                is_named_first(effects.get(name))
        except NotApplicable as error:
            said = f"- ({error})"
        except PluginError as error:
            reason = effects.get(name).expected_failures.get(is_named_first.__name__)
            said, missed = f"no: {error}" + (f" Announced: {reason}" if reason else ""), missed + 1
        tried += not said.startswith("-")
        print(f"| {name} | {said} | {process_time() - start:.1f} |", flush=True)
    print(f"\n- named first: {tried - missed} of {tried}")


if __name__ == "__main__":
    main()
