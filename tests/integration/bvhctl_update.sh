#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# bvhctl_update.sh MAKE_SCENE MAKE_PROBE BVHCTL BVHD - tests `bvhctl update` through a daemon and without one: frames of
# an animated scene are updated, checked by brute force, built where updates are not possible, and refused where a rule
# is broken. It prints each expectation that does not hold, and its status is 1 if there is one.
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
make_scene=$(realpath "$1")
make_probe=$(realpath "$2")
bvhctl=$(realpath "$3")
bvhd=$(realpath "$4")
# shellcheck source=tests/support/scratch.sh
. "$(dirname "$0")/../support/scratch.sh"

export BVHD_SOCKET="$scratch/s"

# has TEXT - checks that the last run printed TEXT to stdout.
has()
{
    expect "it prints '$1': $(head -c 1500 out)" grep -Fq -- "$1" out
}

# is_right DIR SCENE - checks a directory against brute force.
is_right()
{
    run 0 check "$1" "$2" --rays 100 --json
    has '"wrong_miss":0,'
}

start()
{
    "$bvhd" --socket s --no-cache 2>log &
    daemon=$!
    run 0 --connect-timeout 30 -q ping
}

# quad FILE X Y - writes two triangles, one of whose corners has the coordinate X; Y is one of the other triangle.
quad()
{
    {
        printf 'ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n'
        printf 'element face 2\nproperty list uchar int vertex_indices\nend_header\n'
        printf '%s 0 0\n1 0 0\n0 1 0\n0 0 2\n1 0 2\n0 %s 2\n3 0 1 2\n3 3 4 5\n' "$2" "$3"
    } >"$1"
}

"$make_scene" dance --size 3000 -o dance.glb >/dev/null
"$make_probe" 1 10 device >/dev/null
start

# A moment in place: files of the moment before are gone, the manifest has the new one, and rays find its triangles.
run 0 build dance.glb --at 0 -o moving --flags allow-update,allow-compaction
files=$(find moving | wc -l)
is_right moving dance.glb
run 0 update moving dance.glb --at 0.7 --json
one_json_object
has '"frames":[{"time":0.7,"output":"moving","structures":[{"file":"dance.blas-ground-'
has '"built":0,"updated":5,"lost":0,"other_active":0,"decayed":0,"errors":[],'
expect 'as many files as before' [ "$(find moving | wc -l)" -eq "$files" ]
expect 'the manifest has the moment' grep -q '"time": 0.7' moving/manifest.json
expect 'and says that they were updated' grep -q '"refits": 1' moving/manifest.json
is_right moving dance.glb
run 0 query moving/dance.tlas.as
has 'flags                  allow-update allow-compaction'
sums moving | grep '\.as$' >before
run 0 update moving dance.glb
sums moving | grep '\.as$' >after
expect 'without a moment it is the one that it was built at' cmp -s before after
sums moving >before

# Frames, each in a directory of its own.
run 0 update moving dance.glb --frames 1:2:0.5 -o seq
has 'seq/0002: 2 s'
has '3 frames: 15 updated, 0 built'
for frame in 0000 0001 0002; do
    is_right seq/$frame dance.glb
done
sums moving >after
expect "the directory stays" cmp -s before after
run 0 update moving dance.glb --frames 1:2:0.5 -q
expect 'the last frame stays' grep -q '"time": 2' moving/manifest.json
run 0 update moving dance.glb --at 3 --decay 0.01 --json
has '"built":0,"updated":0,"lost":0,"other_active":0,"decayed":5,'
is_right moving dance.glb

# A container, and a native target.
run 0 build dance.glb --at 0 -o dance.bvhd --flags allow-update
run 0 update dance.bvhd dance.glb --at 1.5
has '1 frame: 5 updated, 0 built'
is_right dance.bvhd dance.glb
run 0 build dance.glb --at 0 -o native --flags allow-update --probe device
run 0 update native dance.glb --at 1.5 --probe device
has '1 frame: 5 updated, 0 built'
is_right native dance.glb

# Moved geometry of another file, at rest.
quad quad.ply 0 1
quad moved.ply 0.5 3
quad nan.ply nan 1
run 0 build quad.ply -o quad --flags allow-update
run 0 update quad moved.ply
has '1 frame: 2 updated, 0 built'
is_right quad moved.ply
expect 'files have the name of the new scene' [ -e quad/moved.tlas.as ]
expect 'those of the old one are gone' [ ! -e quad/quad.tlas.as ]
run 0 update quad nan.ply
has ', built: other primitives are active'

# Two equal meshes have one file, and a source each that is found by the nodes.
cat >twins.gltf <<'END'
{"asset":{"version":"2.0"},"nodes":[{"mesh":0},{"mesh":1,"translation":[0,0,5]}],
"meshes":[{"name":"m","primitives":[{"attributes":{"POSITION":0}}]},
{"name":"m","primitives":[{"attributes":{"POSITION":0}}]}],
"bufferViews":[{"buffer":0,"byteLength":36}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],
"buffers":[{"byteLength":36,"uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAAEAAAAAA"}]}
END
run 0 build twins.gltf -o twins --flags allow-update
expect 'one file for both' [ "$(find twins -name '*blas*' | wc -l)" -eq 1 ]
run 0 update twins twins.gltf
has '1 frame: 3 updated, 0 built'
sed 's/"translation":.0,0,5./"children":[2]},{"mesh":1/' twins.gltf >three.gltf
run 1 update twins three.gltf
says 'it was built from another scene'

# A source that the service does not have any more is built, and the next one is updated.
kill "$daemon"
wait "$daemon"
start
run 0 update seq/0000 dance.glb --frames 0:1:1
has '2 frames: 5 updated, 5 built (0 had decayed, 5 were lost, 0 have other active primitives)'
is_right seq/0000 dance.glb

# What is refused.
"$make_scene" sphere --size 200 -o ball.ply >/dev/null
run 0 build ball.ply quad.ply -o two --flags allow-update
run 1 update two ball.ply
says 'two: it has 2 top levels'
run 0 build ball.ply -o plain
run 1 update plain ball.ply
says 'plain: it was built without --flags allow-update'
run 1 update missing ball.ply
one_error_line
run 0 build ball.ply -o ball --flags allow-update
run 1 update ball missing.ply
one_error_line
run 1 update ball quad.ply --json
one_json_object
expect 'a rule about updates is named' grep -Eq 'VUID-vkBuildAccelerationStructuresKHR-pInfos-037(58|6[0-9])' out
is_right ball ball.ply
run 1 update ball ball.ply --at 1
says 'it has no moments'
run 1 update quad dance.glb
says 'it was built from another scene'

# Without a daemon: the sources are in the cache on disk, and then the frames before. The bytes are those of a daemon.
run 0 build dance.glb --at 0 -o served --flags allow-update
run 0 update served dance.glb --frames 0.5:1.5:0.5 -o served-seq
kill "$daemon"
wait "$daemon"
daemon=
run 0 --local build dance.glb --at 0 -o alone --flags allow-update --cache kept
run 0 --local update alone dance.glb --frames 0.5:1.5:0.5 -o alone-seq --cache kept --threads 2
has '3 frames: 15 updated, 0 built'
for frame in 0000 0001 0002; do
    sums served-seq/$frame | grep '\.as$' >before
    sums alone-seq/$frame | grep '\.as$' >after
    expect "frame $frame has the bytes of a daemon's" cmp -s before after
done
is_right alone-seq/0002 dance.glb
run 0 --local update alone dance.glb --at 0.5 --cache kept
has '1 frame: 5 updated, 0 built'
sums served-seq/0000 | grep '\.as$' >before
sums alone | grep '\.as$' >after
expect 'so does an update in place' cmp -s before after
# The cache has no results of updates, nor anything that was built without it.
run 0 --local update alone dance.glb --frames 1:2:1 --cache kept
has '2 frames: 5 updated, 5 built (0 had decayed, 5 were lost, 0 have other active primitives)'
is_right alone dance.glb
run 0 --local update alone dance.glb --frames 0:1:1 --no-cache
has '2 frames: 5 updated, 5 built (0 had decayed, 5 were lost, 0 have other active primitives)'
# What is built on the way is the next source, also where it comes from the cache.
for origin in new cached; do
    run 0 --local build dance.glb --at 0 -o $origin --flags allow-update --cache kept
    run 0 --local update $origin dance.glb --frames 3:4:1 --decay 0.01 --cache kept
    has '2 frames: 0 updated, 10 built (10 had decayed, 0 were lost'
    is_right $origin dance.glb
done
run 0 --local build quad.ply -o lone --flags allow-update --cache kept
run 0 --local update lone nan.ply --cache kept
has ', built: other primitives are active'
run 0 --local build dance.glb --at 0 -o native --flags allow-update --probe device --cache kept
run 0 --local update native dance.glb --at 1.5 --probe device --cache kept
has '1 frame: 5 updated, 0 built'
is_right native dance.glb

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
