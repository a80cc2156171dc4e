#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# add.sh BUILD VERSION - adds what this version writes to the corpus, as the folder VERSION beside this file: a scene of
# two meshes in four nodes, in each layout, as a directory and as a container. tests/corpus/README.md says when.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
build=$(cd "$1" && pwd)
target=$here/$2
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"
mkdir -p "$target"
"$build/tests/support/make_scene" sphere --size 60 -o ball.ply >/dev/null
"$build/tests/support/make_probe" 1 10 plain >/dev/null
"$build/tests/support/make_probe" 2 10 compacted >/dev/null
cat >world.gltf <<'END'
{"asset":{"version":"2.0"},"scene":0,"scenes":[{"name":"day","nodes":[0,1,2,3]}],
"nodes":[{"name":"floor","mesh":0,"scale":[4,1,4]},{"name":"post","mesh":1},
{"name":"turned","mesh":1,"translation":[3,0.5,0],"rotation":[0,0.3826834,0,0.9238795]},
{"name":"far","mesh":1,"translation":[-2,0,2.25],"scale":[0.5,2,0.5]}],
"meshes":[{"name":"tile","primitives":[{"attributes":{"POSITION":0},"mode":5,"material":0}]},
{"name":"wedge","primitives":[{"attributes":{"POSITION":1}},{"attributes":{"POSITION":1},"mode":6}]}],
"materials":[{"name":"clay","pbrMetallicRoughness":{"baseColorFactor":[0.5,0.25,0.125,1]}}],
"bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":72}],
"accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[-1,0,-1],"max":[1,0,1]},
{"bufferView":1,"componentType":5126,"count":6,"type":"VEC3","min":[0,0,0],"max":[1,2,1]}],
"buffers":[{"byteLength":120,"uri":"data:;base64,BUFFER"}]}
END
floats='-1 0 -1  -1 0 1  1 0 -1  1 0 1  0 0 0  1 0 0  0 2 0  1 0 0  1 0 1  0 2 0'
bytes=$(for float in $floats; do
    case $float in
    -1) printf '%s' '\000\000\200\277' ;;
    0) printf '%s' '\000\000\000\000' ;;
    1) printf '%s' '\000\000\200\077' ;;
    2) printf '%s' '\000\000\000\100' ;;
    esac
done)
# shellcheck disable=SC2059 # the bytes are the format
buffer=$(printf "$bytes" | base64 -w 0)
sed -i "s|BUFFER|$buffer|" world.gltf
# put NAME OPTION... - builds the scene as a directory and as a container, unless they are there.
put()
{
    name=$1
    shift
    for output in "$name" "$name.bvhd"; do
        [ -e "$target/$output" ] ||
            "$build/client/bvhctl/bvhctl" --local build --no-cache world.gltf ball.ply -o "$target/$output" "$@"
    done
}
put portable
put fast-triangles --layout fast-triangles --quality high
put lavapipe-plain --probe plain
put lavapipe-compacted --probe compacted --quality fast
