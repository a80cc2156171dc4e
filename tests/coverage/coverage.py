# SPDX-License-Identifier: Apache-2.0
"""Judges what the tests have executed of the product's code.

coverage.py BUILD [--show PATH...]

BUILD is a build folder of gcc with -Db_coverage=true whose tests have run. The status is 1 unless
at least LEAST percent of all lines of the product were executed, every line of the decoders, and
every branch of theirs that is not listed in untaken.txt, and unless the list names only branches
that are there and were not taken. --show prints the lines and branches of these files or folders
that no test takes.
"""

import json
import os
import re
import subprocess
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

LEAST = 90.0
PRODUCT = ("proto", "builder", "daemon", "client")
EXAMPLES = "client/examples/"
HERE = Path(__file__).resolve().parent


class Source:
    """One file: how often its lines were executed, and which branches of them were taken."""

    def __init__(self, text):
        self.text = [line.strip() for line in text.splitlines()]
        self.lines = Counter()
        self.branches = {}
        self.assertions = assertion_lines(self.text)

    def add(self, row):
        """Adds a line of gcov's report. Files that several objects contain have several."""
        number = row["line_number"]
        self.lines[number] += row["count"]
        taken = [branch["count"] for branch in row["branches"]]
        if not taken or number in self.assertions:
            return
        key = (number, row.get("function_name"), len(taken))
        before = self.branches.get(key, [0] * len(taken))
        self.branches[key] = [a + b for a, b in zip(before, taken)]

    def unexecuted(self):
        return sorted(number for number, count in self.lines.items() if count == 0)

    def untaken(self):
        """The branches that were not taken, as (line number, text of the line, how many)."""
        result = []
        for (number, _, _), taken in sorted(self.branches.items(), key=lambda item: item[0][0]):
            missing = sum(count == 0 for count in taken)
            if missing and self.lines[number] > 0:
                result.append((number, self.text[number - 1], missing))
        return result


def assertion_lines(text):
    """The numbers of the lines of assertions, which have a branch that nothing may take."""
    numbers = set()
    inside = False
    for number, line in enumerate(text, 1):
        inside = inside or re.match(r"(_Static_)?assert\(", line) is not None
        if inside:
            numbers.add(number)
            inside = not line.endswith(";")
    return numbers


def is_product(path):
    folders = tuple(f"{folder}/" for folder in PRODUCT)
    return path.startswith(folders) and not path.startswith(EXAMPLES)


def run_gcov(build, notes):
    """Yields gcov's reports of some objects, each named by its file of notes."""
    command = ["gcov", "--json-format", "--stdout", "--branch-probabilities", *notes]
    output = subprocess.run(command, cwd=build, check=True, stdout=subprocess.PIPE,
                            stderr=subprocess.DEVNULL).stdout
    return [json.loads(line) for line in output.splitlines() if line]


def measure(root, build):
    """Returns the sources of the product by their paths from the root."""
    notes = [str(path) for folder in PRODUCT for path in sorted((build / folder).rglob("*.gcno"))
             if EXAMPLES not in str(path)]
    packs = [notes[i:i + 32] for i in range(0, len(notes), 32)]
    sources = {}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for report in (one for pack in pool.map(lambda pack: run_gcov(build, pack), packs)
                       for one in pack):
            for file in report["files"]:
                add_file(root, build, file, sources)
    return sources


def add_file(root, build, file, sources):
    path = os.path.relpath((build / file["file"]).resolve(), root)
    if not is_product(path):
        return
    if path not in sources:
        sources[path] = Source((root / path).read_text(encoding="utf-8"))
    for row in file["lines"]:
        sources[path].add(row)


def read_decoders(path):
    lines = (line.strip() for line in path.read_text(encoding="utf-8").splitlines())
    return [line for line in lines if line and not line.startswith("#")]


def read_untaken(path):
    """Reads {(path, text of the line): number of branches}. Each entry has to give a reason."""
    listed = Counter()
    for entry in re.split(r"\n\s*\n", path.read_text(encoding="utf-8")):
        lines = [line for line in entry.splitlines() if line and not line.startswith("#")]
        if not lines:
            continue
        place = re.fullmatch(r"(\S+): (.+)", lines[0])
        reason = re.match(r"\s+(\d+): \S+ \S+", lines[1]) if len(lines) > 1 else None
        if not place or not reason:
            raise SystemExit(f"{path}: not 'PATH: LINE' and '  NUMBER: REASON':\n{entry}")
        listed[place.groups()] += int(reason.group(1))
    return listed


def judge_total(sources, say):
    executed = sum(count > 0 for source in sources.values() for count in source.lines.values())
    total = sum(len(source.lines) for source in sources.values())
    percent = 100.0 * executed / total if total else 0.0
    print(f"line coverage {percent:.1f} %: {executed} of {total} lines")
    if percent < LEAST:
        say(f"the tests execute less than {LEAST:.0f} % of all lines")


def judge_decoders(sources, decoders, listed, say):
    """Every line of a decoder was executed; what is listed is exactly what was not taken."""
    lines = branches = 0
    found = Counter()
    for path in decoders:
        if path not in sources:
            say(f"{path}: this decoder is not in the build")
            continue
        lines += len(sources[path].lines)
        branches += sum(len(taken) for taken in sources[path].branches.values())
        for number in sources[path].unexecuted():
            say(f"{path}:{number}: not executed: {sources[path].text[number - 1]}")
        for _, text, missing in sources[path].untaken():
            found[path, text] += missing
    print(f"decoders: {len(decoders)} files, {lines} lines, {branches} branches, "
          f"{sum(listed.values())} of them listed as untaken")
    for place in sorted(found.keys() | listed.keys()):
        if found[place] != listed[place]:
            say(f"{place[0]}: {found[place]} branches not taken, {listed[place]} listed: "
                f"{place[1]}")


def show(sources, prefixes):
    for path in sorted(path for path in sources if path.startswith(tuple(prefixes))):
        source = sources[path]
        print(f"{path}: {len(source.unexecuted())} of {len(source.lines)} lines not executed")
        for number in source.unexecuted():
            print(f"{number:6} line     {source.text[number - 1]}")
        for number, text, missing in source.untaken():
            print(f"{number:6} {missing} untaken {text}")


def main(arguments):
    if not arguments or arguments[0].startswith("-") or arguments[1:2] not in ([], ["--show"]):
        raise SystemExit(__doc__)
    root = HERE.parent.parent
    sources = measure(root, Path(arguments[0]).resolve())
    if len(arguments) > 1:
        show(sources, arguments[2:] or [""])
        return 0
    complaints = []
    judge_total(sources, complaints.append)
    judge_decoders(sources, read_decoders(HERE / "decoders.txt"),
                   read_untaken(HERE / "untaken.txt"), complaints.append)
    print("\n".join(complaints), end="\n" if complaints else "")
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
