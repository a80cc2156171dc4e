# SPDX-License-Identifier: Apache-2.0
"""valid_usage.py SOURCE - compares docs/valid-usage.md with what it speaks of: the rules that the
sources report, the tests that break them, and Vulkan's own list of rules where the version is
installed that the document names. Prints each difference; status 1 if there is one."""

import json
import pathlib
import re
import sys

DOCUMENT = "docs/valid-usage.md"
REGISTRY = pathlib.Path("/usr/share/vulkan/registry/validusage.json")
UNNUMBERED = re.compile(r"\| ([^|`][^|]*) \| ([\w/]+\.c) \| (test_\w+\.c): (\w+) \|")
ROW = re.compile(r"\| `(VUID-(\w+)-[\w-]+)` \| (\S+) \| (.*) \|")
FOLDERS = ("proto", "builder", "client", "daemon")
LEAST_ROWS = 200


def read(path):
    return path.read_text(encoding="utf-8")


class Comparison:
    """The differences that are found between the document and the rest."""

    def __init__(self, source):
        self.source = source
        self.differences = []
        definitions = read(source / "proto/include/bvhd/vuid.def")
        pairs = re.findall(r'BVHD_VUID\((\w+),\s*"(VUID-[\w-]+)"\)', definitions)
        self.names = {vuid: name for name, vuid in pairs}
        self.rows = {}
        lines = read(source / DOCUMENT).splitlines()
        for line in lines:
            self.add_row(line)
        self.unnumbered = [match.groups() for match in map(UNNUMBERED.fullmatch, lines) if match]
        self.tests = {path.name: path for path in (source / "tests/unit").rglob("test_*.c")}
        self.reported = self.find_reported()

    def complain(self, text):
        self.differences.append(text)

    def add_row(self, line):
        match = ROW.fullmatch(line)
        if not match:
            if "VUID-" in line:
                self.complain(f"no row of the table: {line}")
            return
        vuid, _, place, text = match.groups()
        if vuid in self.rows:
            self.complain(f"{vuid}: two rows")
        self.rows[vuid] = (place, text)

    def find_reported(self):
        """Returns the files that report each rule, by the rule's name in vuid.def."""
        files = {}
        for folder in FOLDERS:
            for path in (self.source / folder).rglob("*.c"):
                for name in set(re.findall(r"\bBVHD_VUID_(\w+)", read(path))):
                    files.setdefault(name, set()).add(str(path.relative_to(self.source)))
        return files

    def check_decided(self, vuid, place, text):
        """A rule that is decided: the source reports it, and the test names it."""
        name = self.names.get(vuid)
        if name is None:
            self.complain(f"{vuid}: proto/include/bvhd/vuid.def does not have it")
            return
        if place not in self.reported.get(name, ()):
            self.complain(f"{vuid}: {place} does not report it")
        file, _, word = text.partition(": ")
        if file not in self.tests:
            self.complain(f"{vuid}: there is no test {file}")
            return
        code = read(self.tests[file])
        member = vuid.split("-", 2)[2]
        if not re.search(rf"\b{re.escape(word)}\b", code):
            self.complain(f"{vuid}: {file} has no {word}")
        if f'{member}"' not in code and not re.search(rf"\bBVHD_VUID_{name}\b", code):
            self.complain(f"{vuid}: {file} does not expect it")

    def check_rows(self):
        for vuid, (place, text) in self.rows.items():
            if place != "-":
                self.check_decided(vuid, place, text)
            elif self.names.get(vuid) in self.reported:
                self.complain(f"{vuid}: it is reported, but the table says that it is not")
            elif len(text.split()) < 4:
                self.complain(f"{vuid}: no reason is given")
        for vuid in self.names:
            if vuid not in self.rows:
                self.complain(f"{vuid}: the table does not have it")

    def check_unnumbered(self):
        """The rules without a VUID: both files exist, and the test has the function."""
        if not self.unnumbered:
            self.complain("no rule without a VUID is read")
        for rule, place, file, word in self.unnumbered:
            if not (self.source / place).exists():
                self.complain(f"{rule}: there is no {place}")
            if file not in self.tests or not re.search(rf"\b{word}\b", read(self.tests[file])):
                self.complain(f"{rule}: there is no test {file}: {word}")

    def check_registry(self):
        """The table is complete: it has every rule of each call and struct that it speaks of."""
        if not REGISTRY.exists():
            return
        registry = json.loads(read(REGISTRY))
        if registry["version info"]["api version"] not in read(self.source / DOCUMENT):
            return
        owners = {vuid.split("-")[1] for vuid in self.rows}
        for owner in owners & registry["validation"].keys():
            for rules in registry["validation"][owner].values():
                for rule in rules:
                    if rule["vuid"] not in self.rows:
                        self.complain(f"{rule['vuid']}: the table does not have it")


def main():
    comparison = Comparison(pathlib.Path(sys.argv[1]))
    if len(comparison.rows) < LEAST_ROWS:
        comparison.complain(f"only {len(comparison.rows)} rows are read")
    comparison.check_rows()
    comparison.check_unnumbered()
    comparison.check_registry()
    print("\n".join(comparison.differences))
    return 1 if comparison.differences else 0


if __name__ == "__main__":
    sys.exit(main())
