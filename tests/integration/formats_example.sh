#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# formats_example.sh FORMATS.md BVHCTL - tests that bvhctl builds the structure that FORMATS.md shows byte by byte from
# the PLY file that it shows. It prints each expectation that does not hold, and its status is 1 if there is one.
set -u
export LC_ALL=C
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
formats=$(realpath "$1")
bvhctl=$(realpath "$2")
# shellcheck source=tests/support/scratch.sh
. "$(dirname "$0")/../support/scratch.sh"

sed -n '/^## 8/,$p' "$formats" >section
awk '/^```/ { inside = /^```ply/; next } inside' section >triangle.ply
expect 'there is a PLY file' [ -s triangle.ply ]

# A line of the dump has an offset, then bytes up to the first word that is not one. The offset is the number of bytes
# before it.
awk '/^ +[0-9]+  [0-9a-f][0-9a-f] / {
        if ($1 != count)
            print "offset " $1 " instead of " count + 0 >"wrong_offsets"
        for (i = 2; i <= NF && $i ~ /^[0-9a-f][0-9a-f]$/; i++) {
            count++
            print $i
        }
    }' section >written
expect "offsets count the bytes: $(head -n 3 wrong_offsets 2>/dev/null)" [ ! -e wrong_offsets ]

expect_quietly 'it is built' "$bvhctl" --local build triangle.ply -o built
od -An -v -tx1 built/triangle.blas-*.as | tr -s ' ' '\n' | sed '/^$/d' >bytes
expect 'there are bytes' [ "$(wc -l <bytes)" -gt 300 ]
expect "byte for byte (written <, built >): $(diff written bytes | head -n 5 | tr '\n' ' ')" cmp -s written bytes

echo "$checks expectations, $failures do not hold"
[ $failures -eq 0 ]
