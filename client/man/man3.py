# SPDX-License-Identifier: Apache-2.0
"""Writes the manual pages of section 3 from the comments of the public headers.

usage: man3.py VERSION DATE FOLDER HEADER...   writes the pages into the folder
       man3.py --list HEADER...                prints the names of the pages, one a line

There is a page for each header, and one for each name that the headers declare.
"""
from __future__ import annotations

import re
import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path

sys.dont_write_bytecode = True

from c_header import Declaration, Header, Section, names_in, read_header  # noqa: E402

# Headers that others include have no page of their own; their declarations have.
HIDDEN = ("status.h", "vuid.h")
OPAQUE = "An object whose contents only the library knows. Programs pass pointers to it."


@dataclass
class Book:
    version: str
    date: str
    headers: list[Header]

    def statuses(self) -> dict[str, str]:
        """What each status means."""
        for header in self.headers:
            for one in header.declarations():
                if one.name == "bvhd_status":
                    return {m.text.split(" ")[0]: " ".join(m.comment) for m in one.members}
        return {}

    def pages(self) -> dict[str, list[tuple[Header, Section, Declaration]]]:
        """The library's declarations by name. A function and a struct may share one."""
        found: dict[str, list[tuple[Header, Section, Declaration]]] = {}
        for header in self.headers:
            for section in header.sections:
                for one in section.declarations:
                    if one.name.startswith("bvhd_"):
                        found.setdefault(one.name, []).append((header, section, one))
        return found


def page_name(header: Header) -> str:
    return header.name[:-2]


def roff(text: str) -> str:
    """Escapes a text, and prints names and `code` in bold."""
    text = text.replace("\\", "\\e")
    text = re.sub(r"`([^`]*)`", r"\\fB\1\\fP", text)
    text = re.sub(r"(?<![\w*])\*(ret_\w+)", r"\\fI*\1\\fP", text)
    text = re.sub(r"\b(bvhd_\w+)\b(?!\.[hc]\b)", r"\\fB\1\\fP", text)
    text = text.replace("\\fB\\fB", "\\fB").replace("\\fP\\fP", "\\fP")
    return re.sub(r"(?<=\s)-(?=\d)|^-(?=\d)|--", lambda m: "\\-" * len(m[0]), text)


def capital(text: str) -> str:
    return text[0].upper() + text[1:]


def filled(text: str) -> list[str]:
    """A paragraph in short lines, none of which looks like a request."""
    lines = textwrap.wrap(roff(text), 78, break_long_words=False, break_on_hyphens=False)
    return ["\\&" + line if line[0] in ".'" else line for line in lines]


def verbatim(lines: list[str]) -> list[str]:
    out = []
    for line in textwrap.dedent("\n".join(lines)).split("\n"):
        line = line.replace("\\", "\\e").replace("-", "\\-")
        out.append("\\&" + line if line[:1] in (".", "'") else line)
    return [".PP", ".in +4n", ".nf"] + out + [".fi", ".in"]


def prose(lines: list[str], first: str = ".PP") -> list[str]:
    """Paragraphs, and what is indented as it is. `first` comes before all but the first of them."""
    out: list[str] = []
    block: list[str] = []

    def flush() -> None:
        if not block:
            return
        if block[0].startswith("  "):
            out.extend(verbatim(block))
        else:
            out.extend(([first] if out else []) + filled(" ".join(line.strip() for line in block)))
        block.clear()

    for line in lines:
        if not line or (block and line.startswith("  ") != block[0].startswith("  ")):
            flush()
        if line:
            block.append(line)
    flush()
    return out


def sentences(lines: list[str]) -> list[str]:
    flat = " ".join(line.strip() for line in lines if not line.startswith("  "))
    return re.split(r"(?<=[.:])\s+(?=[A-Z*`])", flat) if flat else []


def summary(one: Declaration) -> str:
    """The first sentence as one line of a list of pages."""
    if not one.comment:
        return OPAQUE.split(".")[0][0].lower() + OPAQUE.split(".")[0][1:]
    text = sentences(one.comment)[0].rstrip(".:").replace("`", "")
    for mark in (";", ":", ",", " ("):
        if len(text) > 90:
            text = text.split(mark)[0]
    if re.match(r"[A-Z][a-z]*\b", text) and not text.startswith("Vulkan"):
        text = text[0].lower() + text[1:]
    return text


def code(one: Declaration) -> list[str]:
    """The code of a declaration; a long prototype has a line for each parameter."""
    text = one.text
    if one.kind == "function":
        text = " ".join(text.split())
        if len(text) > 72:
            text = text.replace("(", "(\n    ", 1).replace(", ", ",\n    ")
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return ["\\fB" + line + "\\fP" for line in text.split("\n")]


def returns(one: Declaration, statuses: dict[str, str]) -> list[str]:
    """The section RETURN VALUE of a function."""
    kind = one.text.split("(")[0].rsplit(one.name, 1)[0].strip()
    if kind == "void":
        return filled("None.")
    said = [s for s in sentences(one.comment) if re.search(r"\b(Returns?|Fails?)\b", s)]
    if kind != "enum bvhd_status":
        said = said or sentences(one.comment)[:1]
        return filled(" ".join(said) if said else "A value of the type above.")
    if not any("BVHD_OK" in sentence for sentence in said):
        said.insert(0, "BVHD_OK, or another status.")
    out = filled(" ".join(said))
    if "ret_error" in one.text:
        out += [".PP"] + filled(
            "On failure *ret_error has the status, the rule that is broken, the place and the"
            " reason, unless ret_error is NULL; other results are untouched."
        )
    for name in dict.fromkeys(re.findall(r"\bBVHD_[A-Z_]+", " ".join(one.comment))):
        if statuses.get(name):
            out += [".TP", ".B " + name, *filled(capital(statuses[name]) + ".")]
    return out


def members(one: Declaration) -> list[str]:
    """The fields or values that have comments."""
    out: list[str] = []
    for member in one.members:
        if not member.comment:
            continue
        out += [".TP", ".B " + member.text.replace("\\", "\\e").replace("-", "\\-")]
        out += prose(member.comment, ".IP")
    return out


def see_also(book: Book, header: Header, section: Section, one: Declaration) -> list[str]:
    pages = book.pages()
    wanted = [page_name(header)] if header.name not in HIDDEN else ["bvhd"]
    wanted += one.group + names_in(one.text) + names_in(" ".join(one.comment))
    if one.kind == "function":
        wanted += [other.name for other in section.declarations if other.kind == "function"]
    else:
        wanted += [
            name for name, declared in pages.items() if one.name in names_in(declared[0][2].text)
        ]
    known = sorted({name for name in wanted if name in pages or name == wanted[0]} - {one.name})
    return [f".BR {name} (3){',' if name != known[-1] else ''}" for name in known]


def start(book: Book, name: str, line: str) -> list[str]:
    return [
        '.\\" SPDX-License-Identifier: Apache-2.0',
        f'.TH {name.upper()} 3 {book.date} "bvhd {book.version}" "Library functions"',
        ".SH NAME",
        f"{name} \\- {roff(line)}",
        ".SH SYNOPSIS",
    ]


def name_page(book: Book, declared: list[tuple[Header, Section, Declaration]]) -> list[str]:
    """The page of one name."""
    header, section, one = declared[0]
    out = start(book, one.name, summary(one))
    included = "bvhd.h" if header.name in HIDDEN else header.name
    out += [".nf", f"\\fB#include <bvhd/{included}>\\fP", ""]
    together = [other for other in section.declarations if other.name in one.group]
    for other in together if len(declared) == 1 else [one for _, _, one in declared]:
        out += code(other)
    out += [".fi", ".SH DESCRIPTION"]
    out += prose([line for _, _, one in declared for line in [*(one.comment or [OPAQUE]), ""]])
    for _, _, other in declared:
        if members(other):
            out += [".SH " + ("VALUES" if other.kind == "enum" else "FIELDS"), *members(other)]
        if other.kind == "function":
            out += [".SH RETURN VALUE", *returns(other, book.statuses())]
    return out + [".SH SEE ALSO", *see_also(book, header, section, one)]


def header_page(book: Book, header: Header) -> list[str]:
    """The page of one header."""
    out = start(book, page_name(header), header.title.split(": ")[0])
    out += [".nf", f"\\fB#include <bvhd/{header.name}>\\fP", ".fi", ".PP"]
    out += ["Link with \\fB\\-lbvhd\\fP", "(\\fBpkg\\-config \\-\\-cflags \\-\\-libs bvhd\\fP)."]
    out += [".SH DESCRIPTION", *filled(capital(header.title) + "."), ".PP", *prose(header.text)]
    sections = list(header.sections)
    if header.name == "bvhd.h":
        sections += [s for other in book.headers if other.name in HIDDEN for s in other.sections]
    for section in sections:
        if section.title:
            out += [".SS " + roff(section.title), *prose(section.text)]
        for one in section.declarations:
            if one.kind == "constants" or not one.name.startswith("bvhd_"):
                out += [".PP", *prose(one.comment), ".PP", ".nf", *code(one), ".fi", *members(one)]
            else:
                own = one.name == page_name(header)
                out += [".TP", f".B struct {one.name}" if own else f".BR {one.name} (3)"]
                out += filled(capital(summary(one)) + ".")
    hidden = (*HIDDEN, header.name)
    pages = [page_name(other) for other in book.headers if other.name not in hidden]
    out += [".SH SEE ALSO", ".BR bvhctl (1),"]
    out += [f".BR {page} (3)," for page in sorted(pages)]
    return out + [".BR bvhd (8)"]


def without_empty_paragraphs(lines: list[str]) -> list[str]:
    out: list[str] = []
    for line in lines:
        if line == ".PP" and out[-1].startswith((".PP", ".SH", ".SS")):
            continue
        out.append(line)
    return out


def main(arguments: list[str]) -> int:
    if arguments[0] == "--list":
        book = Book("", "", [read_header(Path(path)) for path in arguments[1:]])
    else:
        book = Book(*arguments[:2], [read_header(Path(path)) for path in arguments[3:]])
    pages = {page_name(h): header_page(book, h) for h in book.headers if h.name not in HIDDEN}
    for name, declared in book.pages().items():
        # A header may have the name of its main struct, which its page describes, too.
        pages.setdefault(name, name_page(book, declared))
    for name, lines in sorted(pages.items()):
        if arguments[0] == "--list":
            print(name + ".3")
        else:
            text = "\n".join(without_empty_paragraphs(lines)) + "\n"
            Path(arguments[2], name + ".3").write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
