#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# bvhctl_shutter.sh MAKE_SCENE MAKE_PROBE BVHCTL - tests `bvhctl build --shutter`: what of a scene moves, what is said
# about it, and that rays of all times find it. It prints each expectation that does not hold, and its status is 1 if
# there is one.
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
    expect "it prints '$1': $(head -c 1500 out)" grep -Fq -- "$1" out
}

# build DIR ARGUMENTS... - builds into DIR without a daemon.
build()
{
    dir=$1
    shift
    run 0 --local build -o "$dir" "$@"
}

# is_right DIR SCENE - checks a directory against brute force.
is_right()
{
    run 0 check "$1" "$2" --rays 200 --json
    has '"wrong_miss":0,"wrong_hit":0,"wrong_primitive":0'
}

# structures DIR - prints the structures with their sums.
structures()
{
    sums "$1" | grep '\.as$'
}

"$make_scene" fair --size 400 -o fair.glb >/dev/null
"$make_scene" sphere --size 60 -o ball.ply >/dev/null
"$make_probe" 1 10 device >/dev/null

# The fan, the carousel and its seats turn, balls fall, and the flag waves; the ground and the poles stand still.
build fair fair.glb --shutter 0.55:0.59
says 'fair: from 0.55 s to 0.59 s 8 instances move by SRT and 3 by matrices, and the triangles of 1 mesh move'
says "fair: instances are at most "
says "fair: vertices are at most "
says "from where the animation has them: mesh 'flag', at "
is_right fair fair.glb
run 0 --local build fair.glb -o fair --shutter 0.55:0.59 --json
one_json_object
has '"source_moment":{"time":0.55,"end":0.59,"animation":0},'
has '"motion":{"srt_instances":8,"matrix_instances":3,"meshes":1,'
has '{"name":"flag","material":"material 3","primitives":'
has ',"moves":true,'
expect 'the manifest says how nodes move' grep -q '"name": *"ball 0".*"motion": *"matrix"' fair/manifest.json
expect 'and which' [ "$(grep -c '"motion": *"srt"' fair/manifest.json)" -eq 8 ]
run 0 query fair/fair.tlas.as
has 'flags                  motion'
run 0 --local build fair.glb -o fair --shutter 0.55:0.59 -q
expect 'quiet' [ ! -s err ]
build fair.bvhd fair.glb --shutter 0.55:0.59 --quality high
is_right fair.bvhd fair.glb
build named fair.glb --shutter 0.55:0.59 --animation fair
structures fair >before
structures named >after
expect 'the animation by its name is the first' cmp -s before after

# What stands still is as at the moment, and nothing else is built if all does.
build moment fair.glb --at 0.55
expect 'the ground is the same' cmp -s fair/fair.blas-ground-*.as moment/fair.blas-ground-*.as
expect 'the rotor is the same' cmp -s fair/fair.blas-rotor-*.as moment/fair.blas-rotor-*.as
build late fair.glb --at 9
build later fair.glb --shutter 9:10
says 'nothing moves from 9 s to 10 s'
structures late >before
structures later >after
expect 'without motion it is a moment' cmp -s before after
is_right later fair.glb

# A longer interval is farther from the animation.
deviation()
{
    sed 's/.*"instance_deviation":{"distance":\([^,}]*\).*/\1/' out
}
run 0 --local build fair.glb -o near --shutter 0.61:0.65 --json
near=$(deviation)
run 0 --local build fair.glb -o far --shutter 0.61:0.81 --json
far=$(deviation)
expect "$near is less than $far" awk "BEGIN { exit !($near > 0 && 10 * $near < $far) }"
is_right far fair.glb

# Updates go from interval to interval, also from one in which nothing moves.
cache=kept
build updated fair.glb --shutter 9:9.04 --flags allow-update --cache $cache
run 0 trace updated fair.glb --device cpu --size 32x24 -o still.png
is_right updated fair.glb
run 0 --local update updated fair.glb --frames 0.5:0.58:0.04 -o seq --cache $cache
has 'seq/0002: 0.58 s to 0.62 s'
has '3 frames: '
for frame in 0000 0001 0002; do
    is_right seq/$frame fair.glb
done
run 0 --local build fair.glb -o updated --shutter 9:9.04 --flags allow-update --cache $cache -q
run 0 --local update updated fair.glb --shutter 1:1.5 --cache $cache --json
one_json_object
has '"frames":[{"time":1,"end":1.5,'
run 0 trace updated fair.glb --device cpu --size 32x24 -o moving.png
is_right updated fair.glb

build fixed fair.glb --at 1 --flags allow-update --cache $cache
run 1 --local update fixed fair.glb --shutter 1:2 --cache $cache
says 'fixed: it was built without --shutter'
one_error_line

# Points cannot move by their vertices: they stay, which is counted. Their node moves.
cat >dots.gltf <<'END'
{"asset":{"version":"2.0"},"nodes":[{"mesh":0,"name":"dots"}],
"meshes":[{"name":"dots","primitives":[{"mode":0,"attributes":{"POSITION":0},"targets":[{"POSITION":0}]}]}],
"animations":[{"channels":[{"sampler":0,"target":{"node":0,"path":"weights"}},
{"sampler":1,"target":{"node":0,"path":"translation"}}],
"samplers":[{"input":1,"output":1},{"input":1,"output":2}]}],
"bufferViews":[{"buffer":0,"byteLength":36}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
{"bufferView":0,"byteOffset":8,"componentType":5126,"count":2,"type":"SCALAR"},
{"bufferView":0,"byteOffset":12,"componentType":5126,"count":2,"type":"VEC3"}],
"buffers":[{"byteLength":36,"uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAAEAAAAAA"}]}
END
build dots dots.gltf --points 0.1 --shutter 0:1
says 'dots: 1 mesh of points or lines does not move: it stays as at the beginning of the shutter interval'
says 'move by SRT and 1 by matrices, and the triangles of 0 meshes move'
is_right dots dots.gltf

# What is refused.
run 1 --local build ball.ply -o ball --shutter 0:1
says 'it has no moments'
run 1 --local build fair.glb -o none --shutter 0:1 --animation circus
says "animation 'circus'"
run 2 --local build fair.glb -o none --shutter 1:0
says "--shutter: T1 is after T0: '1:0'"
run 2 --local build fair.glb -o none --shutter 0:1 --at 0
one_error_line
run 1 --local build fair.glb -o native --shutter 0:0.1 --probe device
says 'target lavapipe has no motion triangles'
sed 's/"input":1,"output":1/"input":7,"output":1/' dots.gltf >broken.gltf
run 1 --local build broken.gltf -o none --points 0.1 --shutter 0:1
says 'broken.gltf: animations[0].samplers[0].input: accessors[7] does not exist'
sed 's/"input":1,"output":2/"input":0,"output":2/' dots.gltf >broken.gltf
run 1 --local build broken.gltf -o none --points 0.1 --shutter 0:1
says 'broken.gltf: accessors[0]: times of keys are SCALARs of floats'

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
