#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# bvhctl_copy.sh MAKE_SCENE MAKE_PROBE BVHCTL - tests `bvhctl copy` and `bvhctl query` on files of both targets, and on
# files that are no structures. It prints each expectation that does not hold, and its status is 1 if there is one.
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
make_scene=$(realpath "$1")
make_probe=$(realpath "$2")
bvhctl=$(realpath "$3")
# shellcheck source=tests/support/scratch.sh
. "$(dirname "$0")/../support/scratch.sh"

# has TEXT - checks that the last run printed TEXT to stdout.
has()
{
    expect "it prints '$1': $(cat out)" grep -Fq -- "$1" out
}

"$make_scene" sphere --size 300 -o ball.ply >/dev/null
"$make_probe" 1 10 device >/dev/null
"$make_probe" 1 11 other >/dev/null
run 0 --local build ball.ply -o all --flags allow-compaction,allow-update
run 0 --local build ball.ply -o plain --flags allow-update
run 0 --local build ball.ply -o native --probe device
mv all/ball.blas*.as all.as
mv plain/ball.blas*.as plain.as
mv native/ball.tlas.as native.as

# Compaction gives the bytes of a build without its flag, and needs that flag.
run 0 copy --compact all.as compacted.as
expect 'compacted bytes are those of a build without the flag' cmp -s compacted.as plain.as
run 0 copy all.as same.as
expect 'a clone has the same bytes' cmp -s same.as all.as
run 0 copy all.as same.as --json
one_json_object
has '"changed":false}'
run 1 copy --compact plain.as no.as
one_error_line
says 'plain.as: VUID-VkCopyAccelerationStructureInfoKHR-src-03411'
expect 'nothing was written' [ ! -e no.as ]
run 1 copy --compact native.as no.as
says 'VUID-VkCopyAccelerationStructureInfoKHR-src-03411'
run 0 copy native.as native-copy.as
expect 'a native clone has the same bytes' cmp -s native.as native-copy.as
run 1 copy missing.as no.as
one_error_line
run 1 copy all.as no/where.as
one_error_line
run 2 copy all.as
one_error_line

# Properties.
run 0 query all.as --json
one_json_object
has '"type":"blas","target":"portable","flags":["allow-update","allow-compaction"],'
has "\"serialization_size\":$(wc -c <all.as),\"bottom_level_pointers\":null,"
has '"compatible":true}'
run 0 query plain.as
has 'none: it was built without ALLOW_COMPACTION'
run 0 query all/ball.tlas.as
has 'bottom level pointers  1'
has 'references             1'
run 0 query native.as
has 'flags                  not in the bytes'
has 'compatible             not known'
run 0 query native.as --probe device
has 'compatible             yes, with the device of the probe'
run 0 query native.as --probe other --json
has '"compatible":false}'
run 0 query all.as --probe other
has 'compatible             yes'
run 1 query native.as --probe all.as
one_error_line

# Files that are no structures.
: >empty.as
head -c 100 all.as >cut.as
{ cat all.as && printf x; } >long.as
{ head -c 200 all.as && printf XXXXXXXX && tail -c +209 all.as; } >broken.as
for file in empty.as cut.as broken.as ball.ply; do
    run 1 query $file
    one_error_line
    says "$file: VUID-VkCopyMemoryToAccelerationStructureInfoKHR-src-04960"
    run 1 copy $file no.as
    one_error_line
done
run 1 query long.as
one_error_line
says 'long.as: 1 bytes follow the structure'
run 1 query missing.as --json
one_json_object
expect 'nothing was written' [ ! -e no.as ]

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
