#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# bvhctl_round.sh MAKE_SCENE MAKE_PROBE BVHCTL - tests `bvhctl` on points and lines, which become spheres and linear
# swept spheres: what is built, checked, updated and shown of them, and what is refused. It prints each expectation that
# does not hold, and its status is 1 if there is one.
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

"$make_scene" hair --size 60 -o hair.gltf >/dev/null
"$make_scene" cloud --size 900 -o cloud.gltf >/dev/null
"$make_scene" cloud --size 900 -o cloud.ply >/dev/null
"$make_probe" 1 10 device >/dev/null

# Without the options points and lines are counted, and messages and JSON name the option.
run 0 --local build hair.gltf -o plain --json
one_json_object
says "1860 lines are left out (mesh 'hair': 1860); --lines RADIUS reads them"
has '"left_out":{"lines":1860},"left_out_options":["--lines"]'
has '"triangles":5120,"instances":1,'
run 1 --local build cloud.gltf -o none
one_error_line
says 'only 900 points, 0 lines and 0 primitives without positions; --points RADIUS reads points'
run 1 --local build cloud.ply -o none
one_error_line
says 'a point cloud of 900 vertices, without faces; --points RADIUS reads them as spheres'
run 1 --local build cloud.ply -o none --lines 1
says 'a point cloud'
run 0 --local build hair.gltf -o plain2 --points 1
says '1860 lines are left out'

# With them they are built, and rays have the right answers.
run 0 --local build hair.gltf -o hair --lines 0.01 --json
one_json_object
expect 'nothing is left out' [ ! -s err ]
has '"triangles":5120,"lines":1860,"instances":2,'
has '"name":"hair","material":"hair","primitives":1860,"shape":"swept_spheres"'
has '"source_radii":{"lines":0.01}'
expect 'the triangles are the same structure' cmp -s plain/hair.blas-scalp-*.as hair/hair.blas-scalp-*.as
run 0 check hair hair.gltf --rays 300
has '0 wrong'
run 0 --local build cloud.gltf -o cloud --points 0.02
has 'spheres '
run 0 check cloud cloud.gltf --rays 300
has '0 wrong'
run 0 --local build cloud.ply -o ply --points 0.02 --quality high --layout fast-triangles
run 0 check ply cloud.ply --rays 300
has '0 wrong'
run 0 --local build hair.gltf -o hair.bvhd --lines 0.01 --quality fast
run 0 check hair.bvhd hair.gltf --rays 300
has '0 wrong'

# The radii of the file count, and that of the option only where there are none.
run 0 --local build cloud.ply -o other --points 7
expect 'another default gives the same structures' cmp -s ply/cloud.tlas.as other/cloud.tlas.as
sed 's/property float radius/property float weight/' cloud.ply >bare.ply
run 0 --local build bare.ply -o bare --points 0.02
run 0 --local build bare.ply -o bare2 --points 0.03
expect 'the default counts without radii' \
    [ "$(ls bare | grep -c blas)" = 1 -a "$(sums bare | grep blas)" != "$(sums bare2 | grep blas)" ]
run 0 check bare2 bare.ply --rays 300
has '0 wrong'

# What is built can be described, copied and shown.
for file in hair/hair.blas-hair-*.as; do
    run 0 inspect "$file"
    has 'portable version 2, 1860 linear swept spheres of 1860 primitives'
    run 0 inspect "$file" --json
    one_json_object
    run 0 copy "$file" copied.as
    expect 'a copy has the same bytes' cmp -s "$file" copied.as
    run 0 query "$file"
done
run 0 trace hair --device cpu -o hair.png --size 48x32
has '0 wrong'
run 0 trace cloud cloud.gltf --device cpu -o cloud.png --size 48x32
has '0 wrong'

# Shaders give the answers of the CPU, where there is lavapipe to run them.
if "$bvhctl" devices 2>/dev/null | grep -q llvmpipe; then
    run 0 trace hair hair.gltf --device llvmpipe -o device.png --size 32x24
    has ' 0 differ'
    run 0 trace cloud cloud.gltf --device llvmpipe -o device.png --size 32x24
    has ' 0 differ'
fi

# Lines of a mesh beside triangles, in a file whose bytes are in it.
cat >mixed.gltf <<'END'
{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"nodes":[{"name":"n","mesh":0,"scale":[1,2,-3]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}},{"attributes":{"POSITION":0},"mode":3},
{"attributes":{"POSITION":0},"mode":0}]}],"bufferViews":[{"buffer":0,"byteLength":36}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,2,0]}],
"buffers":[{"byteLength":36,"uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAAEAAAAAA"}]}
END
run 0 --local build mixed.gltf -o mixed --points 0.2 --lines 0.1 --flags allow-update
has '3 instances'
run 0 check mixed mixed.gltf --rays 500
has '0 wrong'
run 0 trace mixed mixed.gltf --device cpu -o mixed.png --size 48x32
has '0 wrong'
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 4\nf 1 2 3\nl 1 2 4\np 4\n' >mixed.obj
run 0 --local build mixed.obj -o obj --points 0.2 --lines 0.1
run 0 check obj mixed.obj --rays 500
has '0 wrong'

# Updates move centres, and the manifest says what they read.
sed 's/,"scale":\[1,2,-3\]/,"scale":[1,2,-2]/; s/AACAPwAA/AAAAQAAA/; s/"max":\[1,/"max":[2,/' mixed.gltf >moved.gltf
run 0 --local build mixed.gltf -o moving --points 0.2 --lines 0.1 --flags allow-update --cache cache
mv moved.gltf mixed.gltf
run 0 --local update moving mixed.gltf --cache cache
has ', 0 built'
run 0 check moving mixed.gltf --rays 500
has '0 wrong'

# What is refused.
for radius in 0 -1 nan inf 1e999 '' 1x; do
    run 2 --local build hair.gltf -o bad --lines "$radius"
    one_error_line
    says "--lines: not a positive number: '$radius'"
    run 2 --local build hair.gltf -o bad --points "$radius"
    says "--points: not a positive number: '$radius'"
done
run 2 check hair hair.gltf --lines 1
sed 's/^\(.*"_RADIUS"\):5/\1:4/' hair.gltf >wrong.gltf
cp hair.bin wrong.bin
run 1 --local build wrong.gltf -o bad --lines 1
one_error_line
says 'wrong.gltf: accessors[4]: _RADIUS is a SCALAR of floats'
head -c 200 hair.bin >short.bin
sed 's/hair\.bin/short.bin/' hair.gltf >short.gltf
run 1 --local build short.gltf -o bad --lines 1
one_error_line
printf 'ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n' >negative.ply
printf 'property float radius\nend_header\n0 0 0 1\n1 1 1 -2\n' >>negative.ply
run 1 --local build negative.ply -o bad --points 1
one_error_line
says 'negative.ply: the radius of vertex 1 is -2: it has to be finite and not negative'
run 1 --local build cloud.ply -o bad --points 1 --probe device
says 'target lavapipe has no spheres'

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
