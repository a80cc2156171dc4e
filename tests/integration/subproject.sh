#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# subproject.sh SOURCE COMPILER... - builds bvhd as the subproject of another meson project, with the option
# client_only, where pkg-config knows only what the client library needs; runs the program; and checks what is
# installed. It prints each expectation that does not hold, and its status is 1 if there is one.
set -u
export LC_ALL=C
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
source=$(realpath "$1")
shift
compiler=$*
# shellcheck source=tests/support/scratch.sh
. "$(dirname "$0")/../support/scratch.sh"

mkdir known subprojects
for name in libprotobuf-c vulkan; do
    ln -s "$(pkg-config --variable=pcfiledir $name)/$name.pc" known
done
ln -s "$source" subprojects/bvhd
cat >meson.build <<'END'
project('tool', 'c', default_options: ['c_std=c99', 'werror=true', 'warning_level=3'])
bvhd = dependency('bvhd', version: '>= 0.1', default_options: ['client_only=true'])
executable('tool', 'tool.c', dependencies: bvhd)
message('shaders: ' + bvhd.get_variable('shaderdir'))
END
cat >tool.c <<'END'
#include <bvhd/bvhd_trace.h>
#include <stdio.h>
int main(void)
{
    printf("%s %s\n", bvhd_version(), bvhd_target_name(BVHD_TARGET_PORTABLE));
    return 0;
}
END

PKG_CONFIG_LIBDIR=$scratch/known
export PKG_CONFIG_LIBDIR
unset PKG_CONFIG_PATH LD_LIBRARY_PATH
expect_quietly 'the other libraries are hidden' sh -c '! pkg-config --exists libcrypto || ! pkg-config --exists libuv'
expect_quietly 'the project is configured' env CC="$compiler" meson setup build --prefix="$scratch/installed" \
    --libdir=lib -Dbuildtype=plain --force-fallback-for=bvhd
shaders=$(sed -n 's/^Message: shaders: //p' log)
expect "the shaders: '$shaders'" [ -f "$shaders/bvhd_ray_query.glsl" ]
expect_quietly 'it is built' ninja -C build
expect_quietly 'the program runs' ./build/tool
expect "it prints the version and a target: $(cat log)" grep -qxE '[0-9.]+ portable' log

expect_quietly 'it is installed' meson install -C build --no-rebuild
for path in include/bvhd/bvhd.h lib/libbvhd.so lib/libbvhd.a lib/pkgconfig/bvhd.pc lib/cmake/bvhd/bvhdConfig.cmake \
    share/bvhd/shaders/bvhd_ray_query.glsl; do
    expect "installed: $path" [ -e "installed/$path" ]
done
for path in bin lib/systemd share/bash-completion share/man/man1 share/man/man8; do
    expect "not installed: $path" [ ! -e "installed/$path" ]
done

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
