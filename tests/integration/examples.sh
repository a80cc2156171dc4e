#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# examples.sh SOURCE BUILD COMPILER... - compiles the programs of client/examples against an installed library and runs
# them with a real daemon on this machine's Vulkan device. If $BVHD_VALIDATE is 1, they run under the Khronos validation
# layer, whose messages count as failures. The status is 77 if no device can run any of them.
# shellcheck disable=SC2046,SC2086 # compilers and flags are lists of words
set -u
# shellcheck source=tests/support/installed.sh
. "$(dirname "$0")/../support/installed.sh"

fail()
{
    echo "examples: $*"
    [ ! -f log ] || head -n 20 log
    exit 1
}

install_library >log 2>&1 || fail 'meson install'
shaders=$(pkg --variable=shaderdir)
[ -f "$shaders/bvhd_ray_query.glsl" ] || fail "no shaders in '$shaders'"
LD_LIBRARY_PATH=$(pkg --variable=libdir)
export LD_LIBRARY_PATH

# Memory that the driver leaks is not the examples' fault.
export ASAN_OPTIONS=detect_leaks=0
# The installed Makefile compiles them, outside of the folder that it is in.
PKG_CONFIG_PATH=$(dirname "$config") make -f "$prefix/share/doc/bvhd/examples/Makefile" CC="$compiler" \
    CFLAGS='-pedantic -Wall -Wextra -Werror' PKG_CONFIG="pkg-config --define-variable=prefix=$prefix" >log 2>&1 ||
    fail 'the installed examples do not compile'

"$prefix/bin/bvhd" --socket "$scratch/s.sock" --no-cache >daemon.log 2>&1 &
daemon=$!
export BVHD_SOCKET="$scratch/s.sock"
"$prefix/bin/bvhctl" --connect-timeout 30 ping >log 2>&1 || fail "no daemon: $(cat daemon.log)"

if [ "${BVHD_VALIDATE-}" = 1 ]; then
    export VK_INSTANCE_LAYERS=VK_LAYER_KHRONOS_validation
    export VK_KHRONOS_VALIDATION_REPORT_FLAGS=error,warn VK_KHRONOS_VALIDATION_VALIDATE_SYNC=true
    VK_LOADER_DEBUG=layer ./load_portable >log 2>&1
    grep -q 'Insert instance layer.*VK_LAYER_KHRONOS_validation' log || fail 'the validation layer is not loaded'
fi
# Of 4,096 rays, 2 * 256 hit squares (at heights 0 and 2) and 2 * 136 hit triangles (at heights 1 and 3).
expected='784 of 4096 rays hit something, after 6784.000 in all'
runs=0
for name in load_native load_portable load_scene trace_rays; do
    ./$name >log 2>&1
    got=$?
    if [ $got -eq 77 ]; then
        echo "skipped: $name: $(head -n 1 log)"
        continue
    fi
    # On a device whose native format bvhd does not know, the first program says so. That is correct, too.
    if [ $name = load_native ] && [ $got -eq 1 ] && grep -q '^UNSUPPORTED: ' log; then
        echo "$name: $(tail -n 1 log)"
        continue
    fi
    [ $got -eq 0 ] || fail "$name: status $got"
    [ "$(tail -n 1 log)" = "$expected" ] || fail "$name: expected '$expected'"
    ! grep -Ei 'validation|VUID|warning|error' log >/dev/null || fail "$name: messages"
    [ $name != trace_rays ] || grep -Eq ': [0-9.]+ million rays a second' log || fail "$name: no rate"
    runs=$((runs + 1))
done
# One ray, straight down onto one triangle; each number is a little-endian float.
cat >triangle.ply <<'EOT'
ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
EOT
quarter='\0\0\200\076' one='\0\0\200\077' minus_one='\0\0\200\277' two='\0\0\0\100' zero='\0\0\0\0' mask='\377\0\0\0'
# shellcheck disable=SC2059 # the format is the bytes
printf "$quarter$quarter$one$zero$zero$zero$minus_one$two$zero$mask$zero$zero" >one.rays
"$prefix/bin/bvhctl" --local build --no-cache triangle.ply -o built >log 2>&1 || fail 'no structure of one triangle'
if [ $runs -gt 0 ]; then
    ./trace_files one.rays built/*blas*.as built/*tlas*.as >log 2>&1 || fail 'trace_files failed'
    grep -q '^1 of 1 rays hit something; [0-9.]* million rays a second$' log || fail 'trace_files: no hit'
    runs=$((runs + 1))
fi
echo "$runs examples ran"
[ $runs -gt 0 ] || exit 77
