#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# bvhctl_vulkan.sh MAKE_SCENE MAKE_PROBE BVHCTL - tests bvhctl with the Vulkan devices of this machine: its messages
# without a device, and probes, builds and traces on lavapipe. It prints each expectation that does not hold. Its status
# is 1 if there is one, and 77 if all hold but there is no lavapipe with ray queries.
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
make_scene=$(realpath "$1")
make_probe=$(realpath "$2")
bvhctl=$(realpath "$3")
# shellcheck source=tests/support/scratch.sh
. "$(dirname "$0")/../support/scratch.sh"

# prints TEXT - expects the text on stdout.
prints()
{
    expect "it prints '$1': $(cat out)" grep -Fq -- "$1" out
}

missing()
{
    expect "$1 is not there" [ ! -e "$1" ]
}

# try_without TEXT - expects every command that needs a device to fail with a message that has the text.
try_without()
{
    run 0 devices
    prints 'no Vulkan device: '
    prints "$1"
    run 0 devices --json
    one_json_object
    prints '"devices":[]'
    prints "$1"
    run 1 probe --device auto -o none.probe
    one_error_line
    says "$1"
    missing none.probe
    run 1 --local build ball.ply -o none --target lavapipe
    says 'use --probe FILE'
    run 1 trace ball --device llvmpipe -o none.png
    one_error_line
    missing none.png
}

# name PATTERN - prints the name of the first device whose entry in the listing matches.
name()
{
    sed 's/{"name"/\n&/g' out | grep "$1" | head -n 1 | sed 's/^{"name":"\([^"]*\)".*/\1/'
}

# trace DIRECTORY - traces on the device, and expects that all rays that were compared agree with the CPU.
trace()
{
    run 0 trace "$1" --device "$device" -o "$1.png" --size 96x54 --json
    one_json_object
    prints "\"device\":\"$device\""
    prints '"mismatches":0'
    expect 'rays were compared' grep -Eq '"checked":[0-9]*[1-9]' out
    expect 'a picture' [ -s "$1.png" ]
}

"$make_scene" sphere --size 2000 -o ball.ply >/dev/null
"$make_scene" park --size 3000 -o park.gltf >/dev/null
run 0 --local build ball.ply -o ball
run 0 --local build park.gltf -o park

# There are no drivers, then no loader.
(
    export VK_DRIVER_FILES=/nonexistent VK_ICD_FILENAMES=/nonexistent
    try_without 'mesa-vulkan-drivers'
    echo 'this is no library' >libvulkan.so.1
    export LD_LIBRARY_PATH="$scratch"
    try_without 'libvulkan1'
    exit $((failures > 0))
) || failures=1

run 0 devices --json
one_json_object
device=$(name '"targets":\[[^]]*"lavapipe".*"ray_queries":true')
if [ -z "$device" ]; then
    [ "$failures" -eq 0 ] || exit 1
    echo "skipped: no lavapipe with ray queries here: $(cat out)"
    exit 77
fi

# The device is found by a substring of its name.
run 0 devices
prints "$device"
prints 'portable, lavapipe'
run 0 probe --device LLVMpipe -o a.probe
prints lavapipe
run 0 probe --device "$device" -o b.probe --json
one_json_object
prints '"target":"lavapipe"'
prints "\"device\":\"$device\""
run 0 probe --device 0 -o first.probe
expect 'one device, one probe' cmp -s a.probe first.probe
run 2 probe --device 'of tomorrow' -o c.probe
one_error_line
says "$device"
missing c.probe
run 1 probe --device "$device" -o nowhere/c.probe
one_error_line
run 2 probe --device "$device"

# A build for this machine's device equals one for its probe.
run 0 --local build park.gltf -o native --target lavapipe
run 0 --local build park.gltf -o probed --probe a.probe
run 0 --local build park.gltf -o both --target lavapipe --probe b.probe
expect 'the same bytes for the device and for its probe' same_sums native probed
expect 'the same bytes with the target named' same_sums native both
run 0 --local build ball.ply -o native-ball --target lavapipe

# Native structures are traced by the device's ray queries, portable ones by a compute shader.
trace native
prints '"target":"lavapipe"'
trace native-ball
trace park
prints '"target":"portable"'
trace ball

# Structures for another device are refused.
"$make_probe" 1 10 'another version' >/dev/null
"$make_probe" 2 10 'another layout' >/dev/null
for other in 'another version' 'another layout'; do
    run 0 --local build ball.ply -o "$other built" --probe "$other"
    run 1 trace "$other built" --device "$device" -o other.png
    one_error_line
    says 'bvhctl: trace: ball.blas-'
    says '.as: header.'
    says lavapipe
    missing other.png
done
run 2 trace native --device 'of tomorrow' -o other.png
one_error_line
says "$device"
missing other.png

echo "$checks checks, $failures failures"
[ "$failures" -eq 0 ]
