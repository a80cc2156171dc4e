#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# manuals3.sh SOURCE PAGES - tests the manual pages of section 3 in the folder PAGES: there is one for each exported
# function, each struct and each header; none lacks a section or a description; groff and mandoc report no mistake. It
# prints each expectation that does not hold, and its status is 1 if there is one.
set -u
export LC_ALL=C
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
source=$(realpath "$1")
pages=$(realpath "$2")
# shellcheck source=tests/support/scratch.sh
. "$(dirname "$0")/../support/scratch.sh"

# missing - prints the names of standard input that have no page.
missing()
{
    while read -r name; do
        [ -s "$pages/$name.3" ] || echo "$name"
    done
}

sed -n 's/^    \(bvhd_[a-z_0-9]*\);/\1/p' "$source/client/libbvhd.map" >functions
expect 'functions are exported' [ "$(wc -l <functions)" -gt 50 ]
expect "no page: $(missing <functions | tr '\n' ' ')" [ -z "$(missing <functions)" ]
headers=$(find "$source/client/include/bvhd" "$source/proto/include/bvhd" -name '*.h')
# shellcheck disable=SC2086 # a list of files
cat $headers | sed -n 's/^\(struct\|enum\) \(bvhd_[a-z_0-9]*\)\( {\|;\).*/\2/p' | sort -u >types
expect 'there are structs' [ "$(wc -l <types)" -gt 30 ]
expect "no page: $(missing <types | tr '\n' ' ')" [ -z "$(missing <types)" ]
find "$source/client/include/bvhd" -name '*.h' -exec basename {} .h \; >names
expect "no page: $(missing <names | tr '\n' ' ')" [ -z "$(missing <names)" ]

# faults - prints what is wrong with the pages of functions ("function") and other pages, whose names come by standard
# input: a section that is missing, a section that is nearly empty, or a line NAME without words.
faults()
{
    sed "s|.*|$pages/&.3|" | xargs awk -v kind="$1" '
        function finish() {
            if (page == "")
                return
            needed = "NAME SYNOPSIS DESCRIPTION SEE_ALSO" (kind == "function" ? " RETURN_VALUE" : "")
            count = split(needed, list, " ")
            for (i = 1; i <= count; i++)
                if (words[list[i]] < (list[i] == "DESCRIPTION" ? 4 : list[i] == "NAME" ? 3 : 1))
                    print page ": " list[i] " has " words[list[i]] + 0 " words"
        }
        FNR == 1 { finish(); page = FILENAME; section = ""; split("", words) }
        /^[.]SH / { section = $2 ($3 ? "_" $3 : ""); next }
        section == "SEE_ALSO" && /^[.]BR/ { words[section] += NF; next }
        !/^[.]/ { words[section] += NF }
        END { finish() }'
}
expect "functions: $(faults function <functions)" [ -z "$(faults function <functions)" ]
expect "types: $(faults type <types)" [ -z "$(faults type <types)" ]

cd "$pages" || exit 1
if command -v groff >/dev/null; then
    expect "groff: $(groff -man -Tascii -ww -z ./*.3 2>&1 | head -n 5)" [ -z "$(groff -man -Tascii -ww -z ./*.3 2>&1)" ]
else
    echo 'skipped: 1 expectation of groff, which is missing'
fi
if command -v mandoc >/dev/null; then
    expect "mandoc: $(mandoc -Tlint -W warning ./*.3 | head -n 5)" [ -z "$(mandoc -Tlint -W warning ./*.3)" ]
else
    echo 'skipped: 1 expectation of mandoc, which is missing'
fi

echo "$checks expectations, $failures do not hold"
[ $failures -eq 0 ]
