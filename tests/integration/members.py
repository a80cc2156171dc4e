# SPDX-License-Identifier: Apache-2.0
"""members.py DOCS PRINTED - compares the members of JSON objects with the documents.

The objects are in the files PRINTED/COMMAND.N, the tables in DOCS/json.md and DOCS/manifest.md.
They are compared in both directions. Prints each difference; its status is 1 if there is one.

Members that only a Vulkan device prints are in DEVICE: they are documented, but need no output.
"""
import collections
import json
import os
import re
import sys

STRUCTURES = {"build": "structures[]", "update": "frames[].structures[]",
              "manifest": "structures[]", "inspect": "files[]"}
DEVICE = {("trace", "differ")}
# Rows that stand for the table of structures.
LISTS = {"structures[]", "files[]", "frames[].structures[]"}


def documented(docs):
    """Returns a pair (command, member) for each row of the tables."""
    members = set()
    for page, section in (("json.md", None), ("manifest.md", "manifest")):
        for line in open(os.path.join(docs, page), encoding="utf-8"):
            heading = re.match(r"## (\w+)", line)
            if heading and page == "json.md":
                section = heading.group(1)
            row = re.match(r"\| `([^`]*)` \| ([^|]*) \|", line)
            if not row:
                continue
            member, second = row.group(1), row.group(2)
            if section == "Structures":
                commands = second.strip().split(", ")
                members |= {(name, STRUCTURES[name] + "." + member) for name in commands}
            elif member not in LISTS:
                members.add((section, member))
    return members


def flatten(value, path, members):
    """Adds the paths of all values that are no objects or lists of objects."""
    if isinstance(value, dict):
        for key, inner in value.items():
            flatten(inner, path + "." + key if path else key, members)
    elif isinstance(value, list):
        for inner in value:
            flatten(inner, path + "[]", members)
    else:
        members.add(path)


def normalise(command, path):
    """Counters and what is left out are documented elsewhere; boxes are documented as a whole."""
    if command == "stats" and path not in ("schema", "version", "hit_ratio"):
        return "*"
    path = re.sub(r"^stats\.\w+$", "stats.*", path)
    path = re.sub(r"left_out\.\w+$", "left_out.*", path)
    return re.sub(r"bounds\[\]$", "bounds", path)


def printed(folder):
    members = collections.defaultdict(set)
    for name in os.listdir(folder):
        paths = set()
        with open(os.path.join(folder, name), encoding="utf-8") as file:
            value = json.load(file)
        flatten(value, "", paths)
        command = "Errors" if "error" in value else name.split(".")[0]
        members[command] |= {normalise(command, path) for path in paths}
    return {(command, member) for command, paths in members.items() for member in paths}


def is_of_build(command, member, written):
    """Returns whether an update has printed a member that builds have, too."""
    return command == "update" and ("build", re.sub(r"^frames\[\]\.", "", member)) in written


def main():
    written, seen = documented(sys.argv[1]), printed(sys.argv[2])
    seen = {pair for pair in seen if not is_of_build(*pair, written) or pair in written}
    differences = [f"{name}: not documented: {member}" for name, member in seen - written]
    differences += [f"{name}: not printed: {member}" for name, member in written - seen - DEVICE]
    print("\n".join(sorted(differences)))
    sys.exit(len(differences) > 0 or len(seen) < 100)


main()
