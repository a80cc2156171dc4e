#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# members.sh SOURCE MAKE_SCENE MAKE_PROBE BVHCTL BVHD - tests that the members of JSON output are those that
# docs/json.md and docs/manifest.md list, and no others. It runs the commands so that each member is printed at least
# once. It prints each expectation that does not hold, and its status is 1 if there is one.
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
source=$(realpath "$1")
make_scene=$(realpath "$2")
make_probe=$(realpath "$3")
bvhctl=$(realpath "$4")
bvhd=$(realpath "$5")
here=$(realpath "$(dirname "$0")")
# shellcheck source=tests/support/scratch.sh
. "$(dirname "$0")/../support/scratch.sh"

mkdir printed

# printed COMMAND ARGUMENT... - keeps the output of bvhctl with these arguments as one of that command, whatever its
# status is.
number=0
printed()
{
    command=$1
    shift
    number=$((number + 1))
    "$bvhctl" "$@" --json >"printed/$command.$number" 2>/dev/null
    expect "an object from: bvhctl $*" grep -q '^{"schema":1,' "printed/$command.$number"
}

"$make_scene" sphere --size 100 -o ball.ply >/dev/null
"$make_probe" 1 10 device >/dev/null
"$make_probe" 1 10 unknown >/dev/null
# Another byte in a structure of the probe makes it one of a device that loads nothing native.
size=$(wc -c <unknown)
{ head -c $((size - 100)) device && printf XYZ && tail -c 97 device; } >unknown
cat >yard.gltf <<'END'
{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]},{"name":"night","nodes":[1,2,3]}],
"nodes":[{"mesh":0},{"mesh":0},{"name":"flat","mesh":0,"scale":[0,0,0]},{"mesh":1}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"material":0},{"attributes":{"POSITION":0},"mode":0}]},
{"name":"dots","primitives":[{"attributes":{"POSITION":0},"mode":0}]}],
"materials":[{"pbrMetallicRoughness":{"baseColorFactor":[1,0,0,1]}}],
"bufferViews":[{"buffer":0,"byteLength":36}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,2,0]}],
"buffers":[{"byteLength":36,"uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAAEAAAAAA"}]}
END
{
    printf 'ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n'
    printf 'element face 6\nproperty list uchar int vertex_indices\nend_header\n'
    printf '0 0 0\n1 0 0\n0 1 0\nnan 0 0\n1e999 0 0\n2 0 0\n3 0 1 2\n3 0 1 3\n3 0 1 4\n3 0 1 5\n2 0 1\n1 0\n'
} >odd.ply

printed build --local build yard.gltf odd.ply missing.ply -o out --scene night
printed build --local build yard.gltf ball.ply odd.ply missing.ply -o all --flags allow-update \
    --layout fast-triangles
printed build --local build ball.ply odd.ply -o native --probe device
printed build --local build ball.ply -o ball.bvhd
printed build --local build yard.gltf -o later --at 1.5
printed build --local build yard.gltf odd.ply -o round --points 0.1 --lines 0.2
"$make_scene" dance --size 1000 -o dance.glb >/dev/null
printed build --local build dance.glb -o turning --shutter 0:0.25
cp turning/manifest.json printed/manifest.8
cp out/manifest.json printed/manifest.1
cp round/manifest.json printed/manifest.7
cp all/manifest.json printed/manifest.2
cp native/manifest.json printed/manifest.3
cp later/manifest.json printed/manifest.5
# Without Embree nothing is written; the member that names it is then taken as printed.
if "$bvhctl" --local build ball.ply -o other --builder embree >/dev/null 2>&1; then
    cp other/manifest.json printed/manifest.4
else
    sed 's/"quality"/"builder":"embree",&/' native/manifest.json >printed/manifest.4
fi
for path in all native ball.bvhd turning device unknown; do
    printed inspect inspect $path
done
printed copy copy all/ball.tlas.as copied.as
printed query query all/ball.tlas.as
printed check check ball.bvhd ball.ply --rays 20
printed trace trace ball.bvhd --device cpu -o ball.png --size 16x16
"$bvhd" --socket s --cache daemon 2>log &
daemon=$!
expect "a daemon: $(cat log)" "$bvhctl" --socket s --connect-timeout 30 --quiet ping --json >/dev/null
"$bvhctl" build ball.ply -o moving --flags allow-update --socket s -q
printed update update moving ball.ply --socket s --decay 0.01
printed update update moving ball.ply --socket s
"$make_scene" dance --size 1000 -o dance.glb >/dev/null
"$bvhctl" build dance.glb --at 0 -o dance --flags allow-update --socket s -q
"$make_scene" dance --size 2000 -o dance.glb >/dev/null
printed update update dance dance.glb --socket s
cp moving/manifest.json printed/manifest.6
"$bvhctl" build dance.glb --shutter 0:1 -o swaying --flags allow-update --socket s -q
printed update update swaying dance.glb --frames 0:1:1 --socket s
printed stats stats --socket s
printed clients clients --socket s
printed top top --socket s --count 1
printed cache cache show --socket s
printed cache cache show --cache kept
printed cache cache clear --cache kept
printed Errors inspect missing
expect_quietly 'the members that are printed are those that are documented' python3 "$here/members.py" \
    "$source/docs" printed

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
