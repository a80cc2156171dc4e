#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# bvhctl_output.sh MAKE_SCENE MAKE_PROBE BVHCTL - tests what builds leave behind: containers beside directories, names
# of files, stale files, and what the manifest says about scenes and nodes. It prints each expectation that does not
# hold, and its status is 1 if there is one.
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
make_scene=$(realpath "$1")
make_probe=$(realpath "$2")
bvhctl=$(realpath "$3")
# shellcheck source=tests/support/scratch.sh
. "$(dirname "$0")/../support/scratch.sh"

# mesh NAME HEIGHT - prints a mesh of an OBJ file, a quad whose third corner has that height.
mesh()
{
    printf 'o %s\nv 0 0 0\nv 1 0 0\nv 1 1 %s\nv 0 1 0\nf -4 -3 -2 -1\n' "$1" "$2"
}
"$make_scene" sphere --size 500 -o ball.ply >/dev/null
"$make_probe" 1 10 device >/dev/null
{ mesh wall 0 && mesh roof 3; } >house.obj

# A container is one file, complete or not there; equal input gives equal bytes, and leaves the file untouched.
run 0 --local build ball.ply house.obj -o both.bvhd --depfile both.d --json
one_json_object
expect 'it is one file' [ -f both.bvhd ]
expect 'nothing else was written' [ "$(find . -newer house.obj -type f | grep -c both)" -eq 2 ]
expect 'the report names it' grep -q '"output":"both.bvhd","changed":1,"removed":0' out
expect 'the depfile is a rule for it' grep -q '^both.bvhd: ' both.d
touch -d '2001-01-01' both.bvhd
run 0 --local build ball.ply house.obj -o both.bvhd --threads 1 --json
expect 'nothing has changed' grep -q '"changed":0,"removed":0' out
expect 'the time stays' [ "$(date -r both.bvhd +%Y)" = 2001 ]
run 0 --local build ball.ply house.obj -o again.bvhd --threads 3
expect 'equal input gives equal bytes' cmp -s both.bvhd again.bvhd
run 0 --local build ball.ply house.obj -o both.bvhd --quality fast
expect 'another quality is written' [ "$(date -r both.bvhd +%Y)" != 2001 ]
cp both.bvhd before.bvhd
run 1 --local build ball.ply missing.ply -o both.bvhd
says 'bvhctl: build: both.bvhd: it was not written, because not all of its structures were built'
expect 'a failed build leaves it' cmp -s both.bvhd before.bvhd
run 1 --local build ball.ply -o small.bvhd --memory 1000
expect 'no container without its structures' [ ! -e small.bvhd ]
expect 'no temporary files' [ -z "$(find . -name '*.bvhd.*')" ]
run 1 --local build ball.ply -o no/such/place.bvhd
one_error_line
mkdir folder.bvhd
run 1 --local build ball.ply -o folder.bvhd
one_error_line
says 'not a regular file'
run 0 --local build ball.ply -o .bvhd
expect 'a name that is only the ending means a directory' [ -f .bvhd/manifest.json ]

# Every command reads it like the directory.
for options in '' '--layout fast-triangles' '--probe device'; do
    # shellcheck disable=SC2086 # words
    run 0 --local build ball.ply house.obj -o dir $options
    # shellcheck disable=SC2086 # words
    run 0 --local build ball.ply house.obj -o file.bvhd $options
    run 0 inspect dir --json
    sed 's/"path":"[^"]*",//g' out >of-dir
    run 0 inspect file.bvhd --json
    one_json_object
    expect "inspect finds the same structures, $options" \
        [ "$(sed 's/"path":"[^"]*",//g; s/,"container":.*/}/' out)" = "$(cat of-dir)" ]
    expect 'and says what the container is' grep -Eq '"container":{"path":"file.bvhd","version":1,"structures":5,' out
    run 0 inspect file.bvhd
    expect 'also as text' grep -q '^file.bvhd: container version 1, 5 structures, ' out
    for scene in ball.ply house.obj; do
        run 0 check dir $scene --rays 300
        cp out of-dir
        run 0 check file.bvhd $scene --rays 300
        expect "check finds the same, $scene $options" cmp -s out of-dir
        run 0 trace dir --device cpu -o dir.png --size 32x32 --scene "${scene%.*}"
        run 0 trace file.bvhd --device cpu -o file.png --size 32x32 --scene "${scene%.*}"
        expect "trace makes the same picture, $scene $options" cmp -s dir.png file.png
    done
done

# Damaged containers are refused with the place.
head -c 5000 file.bvhd >cut.bvhd
run 3 inspect cut.bvhd --json
one_json_object
expect 'the place of the damage' grep -q '"status":"CORRUPT","vuid":"","where":"cut.bvhd: container.size"' out
run 3 check cut.bvhd ball.ply
run 1 trace cut.bvhd --device cpu -o x.png
{ head -c 500 file.bvhd && printf X && tail -c +502 file.bvhd; } >flipped.bvhd
run 3 inspect flipped.bvhd
says '.checksum: its bytes are damaged'
run 3 check flipped.bvhd ball.ply --rays 10
: >empty.bvhd
run 3 inspect empty.bvhd
run 1 trace ball.ply --device cpu -o x.png
says 'neither a directory nor a container of structures'

# Names of files stay when meshes come, go and move, and when options change. What is stale is removed and counted.
run 0 --local build house.obj -o names
wall=$(cd names && echo house.blas-wall-*.as)
roof=$(cd names && echo house.blas-roof-*.as)
expect 'names have the digest' [ -f "names/$wall" ]
{ mesh door 2 && mesh roof 3 && mesh wall 0; } >more.obj
mkdir moved && mv more.obj moved/house.obj
run 0 --local build moved/house.obj -o names --quality high --json
expect 'nothing is stale' grep -q '"removed":0' out
expect 'the names have stayed' [ -f "names/$wall" ]
expect 'of both' [ -f "names/$roof" ]
mesh wall 1 >moved/house.obj
echo mine >names/house.notes.as
ln -s "$scratch/house.obj" names/house.link.as
cp names/house.tlas.as names/house.copy.as
run 0 --local build moved/house.obj -o names
expect 'three files are stale' grep -q ', 3 stale files removed, ' out
expect 'they are gone' [ ! -e "names/$wall" ]
expect 'only the files of this build are left, and those that bvhctl did not write' \
    [ "$(ls names | grep -v '^house.blas-wall-' | tr '\n' ' ')" = \
        'house.copy.as house.link.as house.notes.as house.tlas.as manifest.json ' ]
expect 'with one mesh' [ "$(find names -name 'house.blas-*' | wc -l)" -eq 1 ]

# A manifest that lists other people's files does not make them stale: their names or bytes are not those of structures.
cp ball.ply names/house.scan.as
size=$(wc -c <ball.ply)
for other in house.scan.as house.notes.as house.link.as ../ball.ply; do
    entry="{\"file\":\"$other\",\"type\":\"blas\",\"scene\":\"house\",\"name\":\"\",\"target\":\"portable\""
    entry="$entry,\"geometries\":[]"
    sed -i "s|^  \"structures\": \[|&$entry,\"bytes\":$size},|" names/manifest.json
done
sed -i 's|"../ball.ply"|"ball.ply"|' names/manifest.json
cp ball.ply names/ball.ply
run 0 --local build house.obj -o names
expect 'one file is stale' grep -q ', 1 stale file removed, ' out
for kept in house.scan.as house.notes.as house.link.as ball.ply; do
    expect "not removed: $kept" [ -e "names/$kept" ]
done
run 0 --local build house.obj -o names
run 0 --local build ball.ply -o names
expect 'files of another scene are not stale' [ -f "names/$wall" ]
run 0 --local build house.obj -o names
wall_before=$(cd names && ls house.blas-wall-*.as)
mesh wall 5 >moved/house.obj
run 1 --local build moved/house.obj missing.ply -o names
expect 'nothing is removed after a failure' [ -f "names/$wall_before" ]

# Equal meshes with equal names share a file.
cat >posts.gltf <<'END'
{"asset":{"version":"2.0"},"scenes":[{"nodes":[0,1,2]}],
"nodes":[{"mesh":0},{"mesh":1,"translation":[9,0,0]},{"mesh":2,"translation":[0,9,0]}],
"meshes":[{"name":"post","primitives":[{"attributes":{"POSITION":0}}]},
{"name":"post","primitives":[{"attributes":{"POSITION":0}}]},
{"name":"rail","primitives":[{"attributes":{"POSITION":0}}]}],
"bufferViews":[{"buffer":0,"byteLength":36}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,2,0]}],
"buffers":[{"byteLength":36,"uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAAEAAAAAA"}]}
END
run 0 --local build posts.gltf -o posts
expect 'two names, two files' [ "$(find posts -name 'posts.blas-*' | wc -l)" -eq 2 ]
expect 'one handle for equal meshes' [ "$(sed -n '/"handles"/,/]/p' posts/manifest.json | grep -c '\.as"')" -eq 1 ]
run 0 check posts posts.gltf --rays 300
run 0 --local build posts.gltf -o posts.bvhd
run 0 check posts.bvhd posts.gltf --rays 300

# The manifest: tool, options, sources, nodes. Python reads it as JSON.
cat >yard.gltf <<'END'
{"asset":{"version":"2.0"},"scenes":[{"name":"day","nodes":[0]},{"name":"night","nodes":[1,2]}],
"nodes":[{"mesh":0},{"name":"a \"b\" \u00e4","mesh":0,"translation":[9,0.1,0],"children":[3]},
{"name":"flat","mesh":0,"scale":[0,0,0]},{"name":"child","mesh":0,"scale":[2,3,4]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
"bufferViews":[{"buffer":0,"byteLength":36}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,2,0]}],
"buffers":[{"byteLength":36,"uri":"yard.bin"}]}
END
printf '\0\0\0\0\0\0\0\0\0\0\0\0\0\0\200\077\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\100\0\0\0\0' >yard.bin
run 0 --local build yard.gltf -o yard --scene night --quality fast --rays 2.5 --flags allow-update,low-memory
cat >manifest.py <<'END'
import json
import sys
manifest = json.load(open(sys.argv[1] + "/manifest.json"))
top = [s for s in manifest["structures"] if s["type"] == "tlas"][0]
bottom = [s for s in manifest["structures"] if s["type"] == "blas"][0]
nodes, scene = top["nodes"], manifest["scenes"][0]
assert manifest["schema"] == 1 and manifest["revision"] == 2, "versions"
assert manifest["tool"]["name"] == "bvhctl" and manifest["tool"]["version"].count(".") == 2, "tool"
assert manifest["options"] == {"target": "portable", "quality": "fast", "flags": ["allow-update", "low-memory"],
                               "layout": [], "geometry_flags": ["opaque"], "rays_per_primitive": 2.5,
                               "scene": "night"}, "options"
assert [n["name"] for n in nodes] == ['a "b" \u00e4', "child", "flat"], "names of nodes"
assert [n["custom_index"] for n in nodes] == [0, 1, 2], "custom indices"
assert all(n["file"] == bottom["file"] for n in nodes), "files of nodes"
assert nodes[0]["transform"] == [1, 0, 0, 9, 0, 1, 0, 0.1, 0, 0, 1, 0], "a transform"
assert nodes[1]["transform"] == [2, 0, 0, 9, 0, 3, 0, 0.1, 0, 0, 4, 0], "a product of transforms"
assert "skipped" not in nodes[0] and nodes[2]["skipped"] is True, "skipped nodes"
assert bottom["bounds"] == [0, 0, 0, 1, 2, 0], "bounds of a mesh"
assert scene["bounds"] == top["bounds"], "bounds of the scene"
assert abs(scene["bounds"][0] - 9) < 1e-5 and abs(scene["bounds"][4] - 6.1) < 1e-5, "what they are"
assert scene["scene"] == "yard" and scene["file"] == "yard.tlas.as" and scene["instances"] == 3, "the scene"
assert [f["path"] for f in scene["files"]] == ["yard.gltf", "yard.bin"], "sources"
assert scene["files"][1]["bytes"] == 36 and scene["files"][1]["xxh64"] == sys.argv[2], "their sizes and digests"
END
expect_quietly 'the manifest says what was built' python3 manifest.py yard e97cdb52e86e887a
mkdir elsewhere && cp yard.gltf yard.bin elsewhere
run 0 --local build elsewhere/yard.gltf -o yard2 --scene night --quality fast --rays 2.5 --flags allow-update,low-memory
expect 'it does not depend on where the scene is' cmp -s yard/manifest.json yard2/manifest.json
run 0 --local build yard.gltf -o yard.bvhd --scene night --quality fast --rays 2.5 --flags allow-update,low-memory
expect 'the container has the same manifest' \
    sh -c 'tail -c "$(($(wc -c <yard/manifest.json) + 1))" yard.bvhd | tr -d "\000" | cmp -s - yard/manifest.json'

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
