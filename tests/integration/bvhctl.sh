#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# bvhctl.sh MAKE_SCENE BVHCTL INTERRUPTS - tests the command line: exit codes, error lines, JSON, files that stay
# untouched. It prints each expectation that does not hold, and its status is 1 if there is one.
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
make_scene=$(realpath "$1")
bvhctl=$(realpath "$2")
interrupts=$(realpath "$3")
# shellcheck source=tests/support/scratch.sh
. "$(dirname "$0")/../support/scratch.sh"

newest()
{
    find "$1" -type f -newer "$2"
}

"$make_scene" sphere --size 500 -o ball.ply >/dev/null
"$make_scene" grid --size 300 -o 'flat land.ply' >/dev/null
"$make_scene" nan --size 300 -o nan.ply >/dev/null
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nl 1 2\n' >mixed.obj

# Wrong usage, help and version.
run 2
one_error_line
run 2 fly
one_error_line
run 2 --local build ball.ply
one_error_line
run 2 --local build ball.ply -o d --quality best
one_error_line
run 2 --local build ball.ply -o ''
one_error_line
run 2 trace d --device cpu -o ''
run 2 build --json --nonsense
one_error_line
one_json_object
expect 'the error object names the option' \
    grep -q '"error":{"status":"INVALID","vuid":"","where":"--nonsense","text":"' out
run 0 --help
expect 'the help names the commands' grep -q trace out
run 0 build --help
expect 'the help names the options' grep -q -- --depfile out
run 0 --version
expect 'a version' grep -Eq '^bvhctl [0-9]+\.[0-9]+\.[0-9]+$' out

# The reader of the output has gone (yes notices that and ends), or streams are closed.
for word in --version --help 'build --help'; do
    { yes 2>/dev/null; "$bvhctl" $word 2>err; echo $? >code; } | :
    expect "a lost reader is a failure of $word: $(cat code)" [ "$(cat code)" = 1 ]
    one_error_line
done
"$bvhctl" --local build ball.ply -o closed >&- 2>err
expect 'a closed output fails' [ $? -eq 1 ]
one_error_line
expect 'yet the files are there' [ -f closed/ball.tlas.as ]
"$bvhctl" --local build ball.ply -o closed2 --json <&- >out 2>&-
expect 'closed input and messages do not matter' [ $? -eq 0 ]
one_json_object
"$bvhctl" --local build ball.ply -o closed3 <&- >&- 2>&-
expect 'nor does it take a stream to build' [ -f closed3/manifest.json ]

# There is no daemon. bvhctl_daemon.sh has more tests of that.
run 4 --socket "$scratch/none.sock" --connect-timeout 0 build ball.ply -o d
one_error_line
run 4 --socket "$scratch/none.sock" --connect-timeout 0 build ball.ply -o d --json
one_json_object
expect 'the error is UNAVAILABLE' grep -q '"status":"UNAVAILABLE"' out
expect 'nothing was written' [ ! -e d ]

# An interrupt at a terminal also reaches the process that imports. The only message is that bvhctl was interrupted.
large=$((${SIZE:-20000} * 20))
"$make_scene" sphere --size $large -o large.ply >/dev/null
for seconds in 0.02 0.05 0.1 0.2; do
    timeout --preserve-status -s INT $seconds "$bvhctl" --local build large.ply -o interrupted >out 2>err
    expect "interrupted after $seconds s: $(cat err)" [ "$(grep -vc ': interrupted$' err)" -eq 0 ]
done

# A signal ends build, check and trace as it ends any program, and leaves no part of a file.
run 0 --local build large.ply -o cut
for signal in INT TERM; do
    [ $signal = INT ] && number=2 || number=15
    for command in '--local build large.ply --quality high -o cut-build' 'check cut large.ply --rays 20000' \
        'trace cut --device cpu --size 3000x3000 -o cut/picture.png'; do
        # shellcheck disable=SC2086 # a list of words
        "$interrupts" $signal 100 "$bvhctl" $command >out 2>err
        expect "$command dies of the signal: $(cat out err)" grep -qx "signal $number" out
        expect "it says so: $(cat err)" grep -q ': signal: interrupted$' err
    done
done
expect 'no parts of files' [ -z "$(find cut cut-build -name '*.??????')" ]
expect 'no picture' [ ! -e cut/picture.png ]
expect 'no manifest' [ ! -e cut-build/manifest.json ]

# Structures without a result at their deadline are cancelled; those with enough time are built.
run 2 --local build ball.ply -o late --deadline 0
one_error_line
run 1 --local build large.ply -o late --quality high --deadline 1 --json
one_json_object
expect 'the deadline is the reason' grep -q '"status":"CANCELLED".*"where":"deadline"' out
expect 'nothing is written' [ ! -e late/manifest.json ]
run 0 --local build ball.ply -o late --deadline 3600000

# Errors only, or more.
run 0 -q --local build nan.ply -o quiet
expect 'nothing but errors' [ ! -s out ]
expect 'and there is none' [ ! -s err ]
run 0 check quiet nan.ply --quiet
expect 'a check is its exit status' [ ! -s out ]
expect 'and says nothing' [ ! -s err ]
run 1 -q --local build missing.ply -o quiet
one_error_line
run 0 -q --local build nan.ply -o quiet --json
one_json_object
run 0 --local -v build nan.ply -o loud
says 'bvhctl: importing nan.ply: '
says 'bvhctl: building nan: 100 %, '
run 0 build --version
expect 'a version' grep -Eq '^bvhctl [0-9]+\.[0-9]+\.[0-9]+$' out

# Builds.
run 0 --local build ball.ply 'flat land.ply' nan.ply mixed.obj -o d --json --depfile 'dep s.d'
one_json_object
for field in structures file type name geometries material primitives triangles instances inactive degenerate skipped \
    bytes key cached coalesced prepare_ms build_ms peak_bytes depth sah refs method quality target wall_ms; do
    expect "the field $field" grep -q "\"$field\":" out
done
expect 'a message counts the lines' grep -q '^bvhctl: mixed: 1 line is left out' err
expect 'inactive triangles are counted' grep -Eq '"scene":"nan".*"inactive":[1-9]' out
expect 'names are made safe' [ -f d/flat_land.tlas.as ]
expect 'a top level names its files' grep -q '"mixed.blas-[^"]*.as"$' d/manifest.json
expect 'no times in the manifest' sh -c '! grep -Eq "_ms|cached|coalesced|peak" d/manifest.json'
expect 'the manifest has handles' grep -q '"handles"' d/manifest.json
expect 'no temporary files' [ "$(find d -type f | wc -l)" -eq 9 ]
expect 'the depfile is a rule for the manifest' grep -q '^d/manifest.json:' 'dep s.d'
expect 'the depfile quotes blanks' grep -q 'flat\\ land.ply' 'dep s.d'

# Unchanged files stay untouched, and the same input gives the same bytes.
touch -d '2001-01-01' d/*
touch -d '2002-02-02' stamp
run 0 --local build ball.ply 'flat land.ply' nan.ply mixed.obj -o d
expect 'nothing was rewritten' [ -z "$(newest d stamp)" ]
for threads in 1 2 8; do
    run 0 --local build ball.ply 'flat land.ply' nan.ply mixed.obj -o "d$threads" --threads $threads
    expect "the same bytes with $threads threads" same_sums d "d$threads"
done
run 0 --local build ball.ply 'flat land.ply' nan.ply mixed.obj -o d --quality fast --flags allow-update
expect 'something was rewritten' [ -n "$(newest d stamp)" ]

# One scene that fails does not affect the others.
run 1 --local build missing.ply ball.ply -o part --json
one_json_object
one_error_line
expect 'the error is listed' \
    grep -q '"errors":\[{"what":"build","status":"NOT_FOUND","vuid":"","where":"missing.ply"' out
expect 'the other scene is there' [ -f part/ball.tlas.as ]
run 1 --local build missing.ply -o none
expect 'a build without a structure has no summary' [ ! -s out ]
run 1 --local build missing.ply -o none --json
one_json_object
expect 'the error object' grep -q '^{"schema":1,"error":{"status":"NOT_FOUND"' out
printf 'o b.tlas\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n' >a.obj
cp a.obj a.blas-0-b.obj
run 0 --local build a.obj a.blas-0-b.obj -o apart
expect 'no scene overwrites files of another' [ "$(find apart -name '*.as' | wc -l)" -eq 4 ]
run 2 --local build ball.ply "$scratch/ball.ply" -o two
one_error_line
run 1 --local build ball.ply -o stamp/inside
one_error_line
run 1 --local build ball.ply -o small --memory 1000
one_error_line
expect "it says what was needed: $(cat err)" \
    grep -Eq '; it needs at least [0-9.]+ KiB, and the limit is 1000 bytes$' err
run 1 --local build large.ply -o small --memory $((large * 60))
expect "a builder says so, too: $(cat err)" \
    grep -Eq '^bvhctl: large.blas-.*: no memory .*; it needs at least [0-9.]+ MiB, and the limit is [0-9.]+ MiB$' err
run 1 --local build ball.ply -o dep --depfile no/such/place.d

# PLY files: what is left out is counted by kind and by mesh, and broken files are refused with the place.
ply_text()
{
    printf 'ply\nformat ascii 1.0\nelement vertex %s\nproperty float x\nproperty float y\nproperty float z\n' "$1"
    printf 'element %s %s\nproperty list uchar int vertex_indices\nend_header\n' "$2" "$3"
    cat
}
printf '0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n2 0 1\n1 3\n0\n' | ply_text 4 face 4 >scraps.ply
run 0 --local build scraps.ply -o scraps --json
one_json_object
expect 'a quad is two triangles' grep -q '"meshes":1,"triangles":2,' out
expect 'kinds are counted' grep -q '"skipped_instances":0,"left_out":{"points":1,"lines":1,"empty_faces":1}' out
expect 'kinds are counted by mesh' grep -q '"primitives":2,"left_out":{"points":1,"lines":1,"empty_faces":1}' out
expect 'the manifest has them, too' grep -q '"empty_faces": 1' scraps/manifest.json
says 'bvhctl: scraps: 1 point is left out'
says 'bvhctl: scraps: 1 line is left out'
says 'bvhctl: scraps: 1 face without corners is left out'
run 0 check scraps scraps.ply --rays 200
says 'bvhctl: scraps: assimp, a second reader, finds the same 2 triangles in the same bounds'
run 0 check scraps scraps.ply --rays 200 --json
one_json_object
expect 'it agrees in JSON' grep -q '"second_reader":{"name":"assimp","result":"agrees"' out
printf '0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n' | ply_text 4 tristrips 1 >strips.ply
run 0 --local build strips.ply -o strips --json
expect 'a strip is two triangles' grep -q '"meshes":1,"triangles":2,' out
printf '0 0 0\n1 0 0\n1 1 0\n' | ply_text 3 face 0 >cloud.ply
run 1 --local build cloud.ply -o none
says 'bvhctl: build: cloud.ply: no triangles in it: it is a point cloud of 3 vertices, without faces'
printf '0 0 0\n1 0 0\n1 1 0\n3 0 1 3\n' | ply_text 3 face 1 >range.ply
run 1 --local build range.ply -o none
says 'bvhctl: build: range.ply: corner 2 of face 0 is vertex 3, but there are only 3'
printf '0 0 0\n1 0 0\n' | ply_text 99999999 face 1 >lie.ply
run 1 --local build lie.ply -o none
says "bvhctl: build: lie.ply: the header says 99999999 rows of 'vertex', but the file has room for 2 at most"

# Scenes that no ray can hit are built with a warning, and check says that it has checked nothing.
printf '0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n3 0 0 1\n' | ply_text 3 face 2 >flat.ply
run 0 --local build flat.ply -o dead
says 'bvhctl: flat: 2 triangles are degenerate: they have no area'
says 'bvhctl: flat: warning: no ray can hit anything in it, because this is so for all its triangles'
run 0 check dead flat.ply --rays 50
says 'bvhctl: flat: warning: no ray hit anything, so that only misses were checked'
printf 'nan 0 0\n1 0 0\n0 1 0\n3 0 1 2\n' | ply_text 3 face 1 >inactive.ply
run 0 --local build inactive.ply -o dead --json
one_json_object
expect 'inactive triangles are counted by mesh' grep -q '"primitives":1,"inactive":1}' out
says 'bvhctl: inactive: warning: no ray can hit anything in it, because this is so for all its triangles'
run 0 --local build ball.ply -o alive
expect 'nothing to say about others' [ ! -s err ]

# A few bytes with which assimp reads for ever are refused soon, and its words are not ours.
printf 'version 1\n\nnodes' >endless.smd
begin=$(date +%s)
run 1 --local build endless.smd -o none
one_error_line
expect 'it takes seconds at most' [ $(($(date +%s) - begin)) -le 20 ]
expect 'nobody calls it broken who does not know' sh -c '! grep -q broken err'
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\np 1\np 2\nl 1 2\n' >dots.obj
run 1 --local build dots.obj -o none
says 'no triangles in it, only 2 points, 1 lines'

# Each of forty nodes names the next one twice, which gives 2^39 instances. The limit on memory is lower than bvhctl's
# own, so that the test is quick.
nodes=
for i in $(seq 39); do
    nodes="$nodes{\"children\":[$i,$i]},"
done
cat >unfold.gltf <<END
{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[$nodes{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"bufferViews":[{"buffer":0,"byteLength":36}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[0,0,0]}],
"buffers":[{"byteLength":36,
"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA"}]}
END
if (ulimit -v 1000000 && "$bvhctl" --version) >out 2>err; then # a sanitizer needs more than that
    (ulimit -v 1000000 && "$bvhctl" --local build unfold.gltf -o unfold --threads 1) >out 2>err
    expect 'memory without end is a failure' [ $? -eq 1 ]
    one_error_line
fi

# glTF: all scenes or one, with one meaning in build, check and trace; what is left out is counted everywhere.
cat >two.gltf <<END
{"asset":{"version":"2.0"},"scene":0,"scenes":[{"name":"day","nodes":[0]},{"name":"night","nodes":[1,2]}],
"nodes":[{"mesh":0},{"mesh":0,"translation":[9,0,0]},{"mesh":0,"translation":[0,9,0]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}},{"attributes":{"POSITION":0},"mode":0}]},{"primitives":[]}],
"bufferViews":[{"buffer":0,"byteLength":36}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,2,0]}],
"buffers":[{"byteLength":36,"uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAAEAAAAAA"}]}
END
run 0 --local build two.gltf -o all --json
one_json_object
expect 'all scenes are built' grep -q '"instances":3,"skipped_instances":0' out
expect 'by mesh, too' grep -q '"primitives":0,"left_out":{"points":3}' out
expect 'what is left out is counted' grep -q '"skipped_instances":0,"left_out":{"points":3,"meshes":1}' out
expect 'and told' grep -q '^bvhctl: two: 1 mesh is left out, because no node has it' err
says "bvhctl: two: 3 points are left out (mesh 'meshes[0]-1': 3)"
tr -d ' \n' <all/manifest.json >flat
expect 'the manifest counts it' grep -q '"left_out":{"points":3,"meshes":1}' flat
run 0 check all two.gltf --rays 100
run 1 check all two.gltf --scene night
one_error_line
for scene in night 1; do
    run 0 --local build two.gltf -o one --scene $scene --json
    expect "scene $scene alone" grep -q '"instances":2,"skipped_instances":0' out
    for same in night 1 two; do
        run 0 check one two.gltf --scene $same --rays 100
        run 0 trace one --device cpu -o one.png --size 16x16 --scene $same
    done
    run 0 check one two.gltf --rays 100
    run 1 check one two.gltf --scene day
    run 1 trace one --device cpu -o one.png --size 16x16 --scene 0
    one_error_line
done
run 1 --local build two.gltf -o none --scene noon
says "bvhctl: build: two.gltf: it has no scene 'noon'; it has 2, counted from 0"
run 1 --local build ball.ply -o none --scene 0
one_error_line
cp two.gltf copy.gltf
run 0 --local build two.gltf copy.gltf -o pair --scene night
for file in two copy; do
    run 0 check pair $file.gltf --scene night --rays 100 --json
    expect "check takes the scene of $file" grep -q "\"scene\":\"$file\"" out
done
run 1 trace pair --device cpu -o one.png --size 16x16 --scene night
one_error_line
run 0 trace pair --device cpu -o one.png --size 16x16 --scene copy
sed 's/"count":3/"count":4/' two.gltf >broken.gltf
run 1 --local build broken.gltf -o none
says 'bvhctl: build: broken.gltf: accessors[0].byteOffset: '
sed 's/"scene":0,/"extensionsRequired":["ACME_shape"],/' two.gltf >acme.gltf
run 1 --local build acme.gltf -o none
says 'bvhctl: build: acme.gltf: extensionsRequired[0]: the file requires ACME_shape'
sed 's/\[1,2,0\]/[1,3,0]/; s/"scenes":.*/"scenes":[{"nodes":[0]}],/' two.gltf >bounds.gltf
run 0 --local build bounds.gltf -o bounds
says 'bvhctl: bounds: 1 array of positions has other bounds than the file says'
run 0 check bounds bounds.gltf --rays 100
says 'bvhctl: bounds: assimp, a second reader, finds the same 1 triangles in the same bounds'

# A build that fails leaves the manifest as it was.
run 0 --local build ball.ply mixed.obj -o kept
cp kept/manifest.json before.json
run 1 --local build missing.ply -o kept
expect 'a failed build leaves the manifest' cmp -s kept/manifest.json before.json
run 1 --local build ball.ply -o kept --memory 1000
expect 'so does one without memory' cmp -s kept/manifest.json before.json
blas=$(cd kept && echo ball.blas-*.as)
rm "kept/$blas"
mkdir "kept/$blas"
run 1 --local build ball.ply mixed.obj -o kept --quality fast --json
one_json_object
expect 'the file in the way is named' grep -q "^bvhctl: $blas: kept/$blas: not a regular file" err
expect 'its top level fails, too' grep -q "^bvhctl: ball.tlas.as: ball: $blas, which it needs, was not written" err
expect 'the manifest has neither' sh -c '! grep -q "\"ball" kept/manifest.json'
expect 'it has the other scene' grep -q mixed.tlas.as kept/manifest.json

# The output is not a plain file: a link stays and its target is written; anything else is left alone.
mkdir elsewhere
echo old >elsewhere/real.d
ln -s elsewhere/real.d link.d
mkfifo pipe.d
run 0 --local build ball.ply -o linked// --depfile link.d
expect 'the link is still one' [ -L link.d ]
expect 'what it leads to was written, with one slash' grep -q '^linked/manifest.json:' elsewhere/real.d
run 1 --local build ball.ply -o linked --depfile pipe.d
one_error_line
expect 'the pipe is still one' [ -p pipe.d ]
run 1 trace linked --device cpu -o pipe.d --size 8x8
one_error_line
expect 'no picture instead of a pipe' [ -p pipe.d ]
expect 'no temporary files beside it' [ -z "$(find . -name '*.d.??????')" ]
expect 'a Vulkan rule is named' \
    sh -c "'$bvhctl' --local build ball.ply -o rule --flags prefer-fast-trace,prefer-fast-build 2>&1 |
        grep -q '^bvhctl: ball.blas-[0-9a-f]*.as: .*VUID-VkAccelerationStructureBuildGeometryInfoKHR-flags-03796'"

# The command check. It says what it costs, and what it had no time for.
run 0 check cut large.ply --rays 100000 --time 0.01 --json
one_json_object
says 'large: 100000 rays need '
says ' tests of a ray and a primitive: about '
says ' s, for at most 1 s (--time)'
says 'warning: brute force had time for '
judged=$(sed 's/.*"judged":\([0-9]*\),.*/\1/' out)
expect "some rays were judged: $judged" [ "$judged" -gt 0 ]
expect "not all: $judged" [ "$judged" -lt 100000 ]
expect 'the others are counted' grep -q "\"rays\":100000,\"judged\":$judged,\"unjudged\":$((100000 - judged))," out
run 0 check cut large.ply --rays 40
expect 'nothing is left out where no time is given' grep -q '^large: 40 rays, .*, t within [0-9.e-]*$' out
run 0 --local build ball.ply mixed.obj -o good
run 0 check good ball.ply --rays 500 --json
one_json_object
for field in rays hits uncertain wrong_miss wrong_hit wrong_primitive t_rel_err_max; do
    expect "the field $field" grep -q "\"$field\":" out
done
cp out first
run 0 check good ball.ply --rays 500 --json
expect 'the same rays again' cmp -s out first
run 0 check good ball.ply --rays 500 --flip-order
run 0 check good mixed.obj --rays 500
run 3 check good nan.ply --scene ball --rays 500 --json
one_json_object
run 1 check good nan.ply
one_error_line
run 1 check nowhere ball.ply
one_error_line

# The command inspect, and damaged files.
run 0 inspect good
run 0 inspect good/ball.tlas.as --json
one_json_object
run 1 inspect missing.as
one_error_line
run 3 inspect ball.ply
one_error_line
says 'bvhctl: inspect: ball.ply: header: this is not a structure'
head -c 1000 "good/$blas" >cut.as
run 3 inspect cut.as --json
one_json_object
expect 'the damage has a place' grep -q '"where":"cut.as: header.serializedSize"' out
cp -r good bad
head -c 1000 "good/$blas" >"bad/$blas"
run 3 check bad ball.ply
one_error_line
run 3 check bad ball.ply --json
one_json_object
expect 'the damaged file is named' grep -q '"error":{"status":"[A-Z]*","vuid":"","where":"ball.blas-' out
rm "bad/$blas"
run 1 check bad ball.ply
one_error_line
cp cut.as "bad/$blas"

# The manifest does not fit the files: the number of handles in the top level decides first. A file that two handles
# name is opened once.
cp -r good more
tr -d '\n' <good/manifest.json | sed 's/"handles": *\[/&"missing.as",/g' >more/manifest.json
run 3 check more ball.ply
expect 'the numbers are compared first' grep -q 'it has 1 handles, the manifest has 2' err
triangle='0 0\nv 1 0 0\nv 0 1 0'
printf "o a\nv 0 $triangle\nf 1 2 3\no b\nv 0 $triangle\nf 4 5 6\n" >twins.obj
printf "o c\nv 5 $triangle\nf 7 8 9\no d\nv 5 $triangle\nf 10 11 12\n" >>twins.obj
run 0 --local build twins.obj -o twins
run 0 check twins twins.obj --rays 500
expect 'one handle for equal meshes' sh -c '! grep -q "^ *\"twins.blas-[bd]-" twins/manifest.json'
first=$(cd twins && echo twins.blas-a-*.as)
sed -i "s/^\( *\)\"twins.blas-c-.*.as\"/\1\"$first\"/" twins/manifest.json
rm twins/twins.blas-c-*.as
run 0 trace twins --device cpu -o twins.png --size 16x16

# Pictures with what only the scene's file has: a texture with holes, and smooth normals.
"$make_scene" gallery-fence -o fence.gltf >/dev/null
run 0 --local build fence.gltf -o fence
run 0 trace fence --device cpu -o fence.png --size 48x32 --json
expect 'textures of the file that is here' grep -q '"textures":true' out
mkdir away && mv fence.gltf fence.bin fence.0.png away
run 0 trace fence --device cpu -o plain.png --size 48x32 --json
expect 'a remark about the file that is not here' grep -q 'fence.gltf: its textures and normals are not shown' err
expect 'no textures' grep -q '"textures":false' out
expect 'another picture' sh -c '! cmp -s fence.png plain.png'
run 0 trace fence away/fence.gltf --device cpu -o named.png --size 48x32
expect 'the same picture by the file that is named' cmp fence.png named.png
rm away/fence.0.png
run 0 trace fence away/fence.gltf --device cpu -o holes.png --size 48x32
expect 'a remark about the image' grep -q 'not shown: 1; the first: away/fence.0.png' err
"$make_scene" gallery-crate -o crate.gltf >/dev/null
run 1 trace fence crate.gltf --device cpu -o other.png --size 48x32
one_error_line
run 0 trace good --device cpu -o turn.png --size 24x16 --turn 3 --fov 40
expect 'three pictures' [ -s turn-0000.png -a -s turn-0002.png -a ! -e turn-0003.png -a ! -e turn.png ]
run 0 trace good --device cpu -o eye.png --size 24x16 --eye 9,0,0 --look-at 0,0,0 --json
expect 'the camera that was asked for' grep -q '"eye":\[9,0,0\]' out
run 2 trace good --device cpu -o eye.png --eye 9,0
one_error_line

# Pictures.
run 0 trace good --device cpu -o a.png --size 48x32 --json --threads 1
one_json_object
for field in device target rays mrays_s mismatches uncertain; do
    expect "the field $field" grep -q "\"$field\":" out
done
expect 'a PNG file' [ "$(head -c 4 a.png | tail -c 3)" = PNG ]
expect 'a ball from outside, and every ray of it compared' grep -q '"checked":1024,"mismatches":0,"uncertain":0' out
printf 'v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n' >quad.obj
run 0 --local build quad.obj -o quad
run 0 trace quad --device cpu -o quad.png --size 48x32 --json
expect 'two triangles are enough to compare' grep -q '"checked":1024,"mismatches":0,"uncertain":[0-9][,}]' out
run 0 trace good --device auto -o b.png --size 48x32 --threads 3
expect 'the same picture with other threads' cmp -s a.png b.png
run 1 trace good --device cpu -o no/such/c.png --size 8x8
one_error_line
named=$("$bvhctl" devices >/dev/null 2>&1 && echo 2 || echo 1) # without any device it is not the name that is wrong
run "$named" trace good --device voodoo -o c.png
one_error_line
run "$named" probe --device voodoo -o c.probe
one_error_line
run 1 trace bad --device cpu -o c.png --size 8x8
expect 'no picture of damaged files' [ ! -e c.png ]

# The output goes to a full disk.
if [ -w /dev/full ]; then
    "$bvhctl" --version >/dev/full 2>err
    expect 'output that cannot be written fails' [ $? -eq 1 ]
    one_error_line
fi

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
