#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# bvhctl_targets.sh MAKE_SCENE MAKE_PROBE BVHCTL BVHD - tests native targets on the command line, for devices that this
# machine need not have: probes from files, keys and bytes in process and through a daemon, manifests, errors. It prints
# each expectation that does not hold, and its status is 1 if there is one.
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
make_scene=$(realpath "$1")
make_probe=$(realpath "$2")
bvhctl=$(realpath "$3")
bvhd=$(realpath "$4")
# shellcheck source=tests/support/scratch.sh
. "$(dirname "$0")/../support/scratch.sh"

keys()
{
    sed -n 's/^ *"key": "\([0-9a-f]*\)".*/\1/p' "$1/manifest.json"
}

"$make_scene" sphere --size 2000 -o ball.ply >/dev/null
"$make_scene" nan --size 500 -o nan.ply >/dev/null
"$make_scene" park --size 1000 -o park.gltf >/dev/null
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n' >one.obj
"$make_probe" 1 10 'plain 10'
"$make_probe" 2 10 'compacted 10'
"$make_probe" 1 11 'plain 11'
expect 'probes were made' [ -s 'plain 11' ]
s=$scratch/s.sock
"$bvhd" --socket "$s" --no-cache >daemon.log 2>&1 &
daemon=$!
run 0 --socket "$s" --connect-timeout 30 ping

# For each kind of device the bytes are the same in process and through a daemon, with the target named or taken from
# the probe. The second request finds the cached result.
for scene in ball.ply nan.ply one.obj park.gltf; do
    name=${scene%.*}
    for probe in 'plain 10' 'compacted 10' 'plain 11'; do
        run 0 --local build $scene -o "local/$name $probe" --probe "$probe" --depfile d
        expect "the probe is an input: $(cat d)" grep -Fq "$(echo "$probe" | sed 's/ /\\ /')" d
        run 0 --socket "$s" build $scene -o "remote/$name $probe" --probe "$probe" --target lavapipe
        expect "the same files: $scene, $probe" same_sums "local/$name $probe" "remote/$name $probe"
        run 0 --socket "$s" build $scene -o "remote/$name $probe" --probe "$probe" --target lavapipe --json
        expect 'found again' sh -c '! grep -q "\"cached\":false" out'
        expect 'the report has the target' grep -q '"target":"lavapipe"' out
        keys "local/$name $probe" >>all-keys
    done
    run 0 --local build $scene -o "local/$name" --target portable
    run 0 --socket "$s" build $scene -o "remote/$name"
    expect "the same files: $scene, portable" same_sums "local/$name" "remote/$name"
    expect 'portable in the manifest' grep -q '"target": "portable"' "local/$name/manifest.json"
    expect 'and nothing else' sh -c "! grep -q lavapipe 'local/$name/manifest.json'"
    keys "local/$name" >>all-keys
done
expect "each device and each target has different keys: $(sort all-keys | uniq -d)" [ -z "$(sort all-keys | uniq -d)" ]
expect 'there are keys' [ "$(wc -l <all-keys)" -gt 30 ]

# Structures begin with the device's UUIDs, and between devices of one variant nothing else differs.
blas=$(cd 'local/ball plain 10' && echo ball.blas-*.as)
tail -c +33 "local/ball plain 10/$blas" >rest10
tail -c +33 "local/ball plain 11/$blas" >rest11
expect 'the rest is the same' cmp -s rest10 rest11
expect 'the UUIDs are not' sh -c "! cmp -s 'local/ball plain 10/$blas' 'local/ball plain 11/$blas'"
expect 'they are the probe'"'"'s' [ "$(head -c 16 "local/ball plain 11/$blas" | od -An -tu1 | tr -s ' ')" = \
    " 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26" ]

# A top level of this target has a handle for each instance, and the manifest lists them in the same order.
top='local/park plain 10/park.tlas.as'
count=$(od -An -tu8 -j 48 -N 8 "$top" | tr -d ' ')
expect "handles of a park: $count" [ "$count" -gt 10 ]
od -An -v -w8 -tu8 -j 56 -N $((8 * count)) "$top" | tr -d ' ' >rows
sed -n '/"handles"/,/]/{s/^ *"\(.*\.as\)",\{0,1\}$/\1/p}' 'local/park plain 10/manifest.json' >names
sed -n '/"handles"/,/]/{s/^ *"\(.*\.as\)",\{0,1\}$/\1/p}' local/park/manifest.json >distinct
expect "as many names as handles ($(wc -l <names))" [ "$(wc -l <names)" -eq "$count" ]
while read -r row; do sed -n "${row}p" distinct; done <rows >wanted
expect 'in the order of the handles' cmp -s names wanted
expect 'more than one of them' [ "$(sort -u names | wc -l)" -gt 1 ]

# The files can be read without the device: traversal in either order of visits agrees with brute force, and inspect
# reads them.
for scene in ball.ply nan.ply one.obj park.gltf; do
    for way in 'plain 10,' 'compacted 10,--flip-order'; do
        directory="local/${scene%.*} ${way%,*}"
        # shellcheck disable=SC2086 # a word or none
        run 0 check "$directory" $scene --rays 300 --json ${way#*,}
        expect "right answers: $(cat out)" grep -q '"wrong_miss":0,"wrong_hit":0,"wrong_primitive":0' out
        expect "to rays that hit something: $(cat out)" sh -c '! grep -q "\"hits\":0," out'
        run 0 inspect "$directory" --json
        expect 'its target' grep -q '"target":"lavapipe","variant":[12],' out
    done
    run 0 inspect "local/${scene%.*} plain 10"
    levels=$(sed -n 's/^  2-wide tree: \([0-9]*\) levels.*/\1/p' out | sort -n | tail -n 1)
    expect "levels within the driver's limit: $levels" [ "$levels" -le 24 ]
done
run 0 trace 'local/park plain 10' --device cpu -o park.png --size 32x18 --json
expect 'the target of the picture' grep -q '"target":"lavapipe"' out

# A file, or the manifest, names another target.
cp -R 'local/park plain 10' mixed
file=$(head -n 1 distinct)
cp "local/park/$file" mixed
run 3 check mixed park.gltf --rays 10
one_error_line
says "bvhctl: check: $file: not of the target that the manifest says"
rm -r mixed
cp -R 'local/park plain 10' mixed
sed -i 's/"target": "lavapipe"/"target": "portable"/' mixed/manifest.json
run 3 check mixed park.gltf --rays 10
says 'not of the target that the manifest says'
sed 's/"target": "lavapipe"/"target": "teapot"/' 'local/park plain 10/manifest.json' >mixed/manifest.json
run 3 inspect mixed
says 'not a target that this version knows'

# inspect shows the device of a probe.
run 0 inspect 'plain 10'
expect 'it prints loads portable, lavapipe (variant 1)' grep -Fq 'loads portable, lavapipe (variant 1)' out
run 0 inspect 'plain 10' --json
one_json_object
expect 'it prints "content":"probe"' grep -Fq '"content":"probe"' out
expect 'it prints "target":"lavapipe"' grep -Fq '"target":"lavapipe"' out
head -c 700 'plain 10' >'cut probe'
run 3 inspect 'cut probe'
one_error_line
says 'probe.size: says'

# There is no device, or the file is not a probe.
export VK_DRIVER_FILES=/nonexistent VK_ICD_FILENAMES=/nonexistent
run 1 --local build one.obj -o none --target lavapipe
one_error_line
says 'bvhctl: build: --target: no Vulkan device here loads lavapipe structures ('
says '); use --probe FILE'
run 1 --socket "$s" build one.obj -o none --target lavapipe --json
expect 'the error as JSON' grep -q '^{"schema":1,"error":{"status":"UNSUPPORTED","vuid":"","where":"--target"' out
run 0 --local build one.obj -o some --target lavapipe --probe 'plain 10'
for file in missing one.obj /dev/null .; do
    run 1 --local build one.obj -o none --probe "$file"
    one_error_line
    says "bvhctl: build: $file: "
done
head -c 500 'plain 10' >part
run 1 --socket "$s" build one.obj -o none --probe part
says 'bvhctl: build: part: '
expect 'nothing was written' [ ! -e none ]
for line in '--probe plain --target portable' '--probe= ' '--target radv' '--target lavapipe --layout fast-triangles' \
    '--probe part --layout fast-triangles'; do
    # shellcheck disable=SC2086 # a list of words
    run 2 --local build one.obj -o none $line
    one_error_line
done

kill "$daemon"
wait "$daemon"
got=$?
daemon=
expect "the daemon ends as it should ($got)" [ $got -eq 0 ]
echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
