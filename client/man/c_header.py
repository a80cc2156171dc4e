# SPDX-License-Identifier: Apache-2.0
"""Reads the public headers: their declarations, each with its comment.

The headers follow one form: a comment stands right before what it describes, or behind a short
declaration on the same line; a declaration right below another one shares its comment; a comment
such as `/* ---- Keys ---- */` begins a section.
"""
from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

# A comment with what stands behind it on its line, a directive, or code up to its end.
_COMMENT = re.compile(r"/\*(.*?)\*/[ \t]*", re.S)
_DIRECTIVE = re.compile(r"#(?:[^\n\\]|\\\n|\\.)*")
_NAME = re.compile(r"\bbvhd_\w+")


@dataclass
class Member:
    """A field of a struct or a value of an enum."""

    text: str
    comment: list[str]


@dataclass
class Declaration:
    """A function, a type, or the anonymous enum of some flags."""

    kind: str  # "function", "struct", "opaque", "enum", "constants" or "typedef"
    name: str  # "" for constants
    text: str  # its code without comments
    comment: list[str]
    group: list[str] = field(default_factory=list)  # the names that share the comment
    members: list[Member] = field(default_factory=list)


@dataclass
class Section:
    title: str
    text: list[str]
    declarations: list[Declaration] = field(default_factory=list)


@dataclass
class Header:
    name: str  # "bvhd.h"
    title: str
    text: list[str]
    sections: list[Section]

    def declarations(self) -> list[Declaration]:
        return [one for section in self.sections for one in section.declarations]


def comment_lines(comment: str) -> list[str]:
    """Returns the lines of a comment without its stars. Indentation beyond one space stays."""
    lines = [re.sub(r"^\s*\*? ?", "", line, count=1) for line in comment.split("\n")]
    lines[0] = lines[0].strip()
    lines = [line.rstrip() for line in lines]
    while lines and not lines[0]:
        lines.pop(0)
    while lines and not lines[-1]:
        lines.pop()
    return lines


def _code_end(text: str, start: int) -> int:
    """Returns where the declaration ends that begins at `start`: behind its semicolon."""
    depth = 0
    at = start
    while at < len(text):
        comment = _COMMENT.match(text, at)
        if comment:
            at = comment.end()
            continue
        depth += {"{": 1, "}": -1}.get(text[at], 0)
        at += 1
        if text[at - 1] == ";" and depth == 0:
            return at
    raise ValueError(f"a declaration without an end: {text[start:start + 60]!r}")


def _classify(code: str) -> tuple[str, str]:
    flat = " ".join(_COMMENT.sub("", code).split())
    if flat.startswith("typedef"):
        return "typedef", _first(r"\(\*(\w+)\)|\b(\w+);$", flat)
    if flat.startswith("BVHD_API"):
        return "function", _first(r"\b(bvhd_\w+)\(", flat)
    body = "{" in flat
    if flat.startswith("struct"):
        return ("struct" if body else "opaque"), _first(r"struct (\w+)", flat)
    if flat.startswith("enum"):
        name = re.match(r"enum (\w+)", flat)
        return ("enum", name[1]) if name else ("constants", "")
    raise ValueError(f"a declaration of no known kind: {flat[:60]!r}")


def _first(pattern: str, text: str) -> str:
    match = re.search(pattern, text)
    if match is None:
        raise ValueError(f"no name in {text[:60]!r}")
    return next(group for group in match.groups() if group)


def _members(code: str) -> list[Member]:
    """Reads the fields or values between the braces, each with the comment before or behind it."""
    inner = code[code.index("{") + 1 : code.rindex("}")]
    end = r";" if code.startswith("struct") else r","
    members: list[Member] = []
    before: list[str] = []
    at = 0
    while at < len(inner):
        comment = _COMMENT.match(inner, at)
        if comment:
            line_start = inner.rfind("\n", 0, at) + 1
            if inner[line_start:at].strip() and members:
                members[-1].comment += comment_lines(comment[1])
            else:
                before = comment_lines(comment[1])
            at = comment.end()
            continue
        if inner[at].isspace():
            at += 1
            continue
        directive = _DIRECTIVE.match(inner, at)
        if directive:
            at = directive.end()
            continue
        item = re.compile(r"[^" + end + r"/]+").match(inner, at)
        if item is None:
            at += 1
            continue
        text = " ".join(item[0].split())
        if text:
            members.append(Member(text, before))
            before = []
        at = item.end()
    return members


def read_header(path: Path) -> Header:
    """Reads one public header."""
    text = path.read_text(encoding="utf-8")
    text = text.replace('extern "C" {', "")
    text = text.replace("#ifdef __cplusplus\n}\n", "#ifdef __cplusplus\n")
    header = Header(path.name, "", [], [Section("", [])])
    comment: list[str] = []
    previous: Declaration | None = None
    at = 0
    blank = True  # whether an empty line or a directive came since the last comment or declaration
    while at < len(text):
        if text[at] == "\n":
            blank = blank or text[at - 1] == "\n"
            if blank:
                comment, previous = [], None
            at += 1
            continue
        if text[at].isspace():
            at += 1
            continue
        match = _COMMENT.match(text, at)
        if match:
            lines = comment_lines(match[1])
            if not header.title and lines[0].startswith(header.name + " - "):
                _set_title(header, lines)
                lines = []
            elif lines[0].startswith("----"):
                header.sections.append(_section(lines))
                lines = []
            comment, previous, blank = lines, None, False
            at = match.end()
            continue
        match = _DIRECTIVE.match(text, at)
        if match:
            at, blank = match.end(), True
            continue
        end = _code_end(text, at)
        kind, name = _classify(text[at:end])
        behind = re.compile(r"[ \t]*/\*(.*?)\*/", re.S).match(text, end)
        one = Declaration(kind, name, _clean(text[at:end]), comment)
        if behind:
            one.comment = comment_lines(behind[1])
            end = behind.end()
        elif not comment and previous is not None and kind == "function":
            one.comment, one.group = previous.comment, previous.group
        one.group.append(name)
        if "{" in text[at:end] and kind in ("struct", "enum", "constants"):
            one.members = _members(text[at:end])
        header.sections[-1].declarations.append(one)
        previous, comment, blank = one, [], False
        at = end
    return header


def _set_title(header: Header, lines: list[str]) -> None:
    end = lines.index("") if "" in lines else len(lines)
    header.title = " ".join(lines[:end])[len(header.name) + 3 :].rstrip(".")
    header.text = lines[end + 1 :]


def _section(lines: list[str]) -> Section:
    flat = " ".join(line.strip() for line in lines).strip("- ")
    title, _, text = flat.partition(": ")
    return Section(title, [text[0].upper() + text[1:]] if text else [])


def _clean(code: str) -> str:
    """Returns the code without comments, and without the mark of exported functions."""
    code = re.sub(r"[ \t]*/\*.*?\*/", "", code, flags=re.S)
    code = re.sub(r"\n\s*\n+", "\n", code)
    code = re.sub(r"\n\s*(?=\*)", " ", code)
    return code.replace("BVHD_API ", "", 1).strip()


def names_in(text: str) -> list[str]:
    """Returns the names of bvhd in a text, each once, in order."""
    return list(dict.fromkeys(_NAME.findall(text)))
