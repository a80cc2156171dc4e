#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# bvhctl_motion.sh MAKE_SCENE BVHCTL - tests `bvhctl` on structures that move: what is checked, described, copied and
# shown of them. It prints each expectation that does not hold, and its status is 1 if there is one.
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
make_scene=$(realpath "$1")
bvhctl=$(realpath "$2")
# shellcheck source=tests/support/scratch.sh
. "$(dirname "$0")/../support/scratch.sh"

# has TEXT - checks that the last run printed TEXT to stdout.
has()
{
    expect "it prints '$1': $(cat out)" grep -Fq -- "$1" out
}

"$make_scene" dance --size 1000 -o dance.glb >/dev/null
"$make_scene" mill -o mill.gltf >/dev/null
run 0 --local build dance.glb -o dance --shutter 0.9:1.2
run 0 --local build mill.gltf -o mill.bvhd --shutter 1:1.2 --quality fast

# Rays of several times have the right answers.
run 0 check dance dance.glb --rays 800
has ' 0 wrong'
run 0 check dance dance.glb --rays 800 --flip-order --seed 3 --json
one_json_object
has '"wrong_miss":0,"wrong_hit":0,"wrong_primitive":0'
run 0 check mill.bvhd mill.gltf --rays 800
has ' 0 wrong'

# They are wrong for another interval, which a manifest claims, although it begins at the same moment.
cp -r dance other
sed 's/"end": *1.2/"end": 1.3/' dance/manifest.json >other/manifest.json
expect 'the manifest is another one' [ "$(cmp -s dance/manifest.json other/manifest.json; echo $?)" = 1 ]
run 3 check other dance.glb --rays 800

# What is built can be described and copied.
for file in dance/dance.blas-worm-*.as; do
    run 0 inspect "$file"
    has ' motion triangles of '
    expect 'moving nodes have 128 bytes' grep -Eq '^  nodes .*, 128\.0 B each$' out
    run 0 inspect "$file" --json
    one_json_object
    has '"content":"motion triangles"'
    run 0 copy "$file" copied.as
    expect 'a copy has the same bytes' cmp -s "$file" copied.as
    run 0 query "$file" --json
    one_json_object
    has '"type":"blas","target":"portable","flags":["motion"]'
done
run 0 inspect dance/dance.tlas.as
has ', 6 motion instances of 6 primitives'
has 'motion: 3 instances stand still, 3 move by SRT and 0 by matrices'
run 0 inspect dance/dance.tlas.as --json
has '"motion":{"srt_instances":3,"matrix_instances":0}'
run 0 copy dance/dance.tlas.as copied.as
run 0 query copied.as
has 'flags                  motion'
run 0 inspect mill.bvhd --json
one_json_object
run 0 --local build dance.glb -o compact --shutter 0.9:1.2 --flags allow-compaction
run 0 copy --compact compact/dance.tlas.as compacted.as
expect 'compaction takes the flag away' cmp -s compacted.as dance/dance.tlas.as

# Pictures are of all times, of some, or of one; textures and normals are found in the scene's file.
run 0 trace dance --device cpu -o all.png --size 48x32
has ' 0 wrong'
expect "nothing is remarked: $(cat err)" [ ! -s err ]
run 0 trace dance dance.glb --device cpu -o some.png --size 48x32 --times 0:0.5 --json
one_json_object
has '"samples":8,"times":[0,0.5]'
run 0 trace dance --device cpu -o one.png --size 48x32 --times 0 --json
has '"samples":4,"times":[0,0]'
run 0 --local build dance.glb -o still --at 0.9
run 0 trace still --device cpu -o still.png --size 48x32
run 0 trace still --device cpu -o never.png --size 48x32 --times 0.25:0.5
expect 'times do not matter for what stands still' cmp -s never.png still.png
expect 'the pictures differ' [ "$(sha256sum all.png some.png one.png | cut -c 1-64 | sort -u | wc -l)" -eq 3 ]
run 0 trace mill.bvhd mill.gltf --device cpu -o mill.png --size 48x32 --samples 3 --json
has '"samples":3,"times":[0,1]'
run 0 trace mill.bvhd --device cpu -o mill.png --size 48x32 --turn 2
for times in 0.5:0.4 2 0:1.5 -1:0 a 0:; do
    run 2 trace dance --device cpu -o bad.png "--times=$times"
    one_error_line
done
run 2 trace dance --device cpu -o bad.png --samples 0

# The file is another one if only the end of its motion differs.
run 0 trace other --device cpu -o other.png --size 48x32
says 'the file has changed since the structures were built from it'

# Shaders give the answers of the CPU, where there is lavapipe to run them.
if "$bvhctl" devices 2>/dev/null | grep -q llvmpipe; then
    run 0 trace dance --device llvmpipe -o device.png --size 32x24 --samples 4
    has ' 0 differ'
    run 0 trace mill.bvhd mill.gltf --device llvmpipe -o device.png --size 32x24 --samples 4
    has ' 0 differ'
fi

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
