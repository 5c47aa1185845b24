"""Compares what the commands give with the record: python -m benchmarks.digest [--write] [--quick] [CASE ...].

Prints every difference (name, before, after, relative) and ends with 1 where there is one. --write records those
that tests/digest_changes.toml lists, and ends with 1 for any other.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.digest.cases import CASES
from benchmarks.digest.compare import differences
from benchmarks.digest.record import RECORD, changed, read_changes, read_record, write_record
from benchmarks.digest.values import Values
from benchmarks.digest.workspace import CommandError, Workspace


def main(arguments: Sequence[str] = ()) -> int:
    """Run the cases, then write or compare; the number of differences decides the exit code."""
    options = _options().parse_args(list(arguments))
    wanted = [name for name, case in CASES.items()
              if (not options.cases or name in options.cases) and (case.quick or not options.quick)]  # fmt: skip
    record = read_record(options.record) if options.record.exists() else {}
    found = 0
    with tempfile.TemporaryDirectory() as folder:
        space = Workspace(Path(folder))
        for name in wanted:
            start = time.perf_counter()
            try:
                values = CASES[name].values(space)
                lines = (
                    list(differences(record[name], values, name)) if name in record else ["not recorded before"]
                )
            except CommandError as error:
                values, lines = {}, [str(error)]
            print(f"{name}: {len(values)} values, {time.perf_counter() - start:.1f} s, "
                  f"{len(lines) or 'no'} differences", flush=True)  # fmt: skip
            print("".join(f"  {line}\n" for line in lines), end="", flush=True)
            if options.write and values:
                record[name], lines = changed(name, record.get(name, values), values, read_changes())
                print("".join(f"  not listed: {line}\n" for line in lines), end="", flush=True)
                write_record(_in_order(record), options.record)
            found += len(lines)
    return 1 if found else 0


def _in_order(record: dict[str, Values]) -> dict[str, Values]:
    return {name: record[name] for name in CASES if name in record}


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.digest", description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}; all where none is named")
    parser.add_argument("--write", action="store_true", help="write the record")
    parser.add_argument("--quick", action="store_true", help="only the cases that run with the ordinary tests")
    parser.add_argument("--record", type=Path, default=RECORD, help="the record's file")
    return parser


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
