#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# cmake_package.sh SOURCE BUILD COMPILER... - uses the installed library from a project of CMake, after the installed
# tree has been moved: both targets, the versions that it accepts, and what it says without Vulkan's headers. It prints
# each expectation that does not hold, and its status is 1 if there is one; 77 where cmake is missing.
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
# shellcheck source=tests/support/installed.sh
. "$(dirname "$0")/../support/installed.sh"

command -v cmake >/dev/null || { echo 'skipped: 13 expectations of the package for CMake, for lack of cmake'; exit 77; }
expect_quietly 'meson install' install_library
[ $failures -eq 0 ] || exit 1
mv "$prefix" "$scratch/moved"
rm -rf "$scratch/stage"

unset LD_LIBRARY_PATH
mkdir project
cat >project/CMakeLists.txt <<'END'
cmake_minimum_required(VERSION 3.16)
project(tool LANGUAGES C)
find_package(bvhd ${WANTED} REQUIRED CONFIG)
foreach(kind bvhd bvhd_static)
    add_executable(tool_${kind} tool.c)
    target_compile_options(tool_${kind} PRIVATE -Wall -Wextra -Werror)
    target_link_libraries(tool_${kind} PRIVATE bvhd::${kind})
endforeach()
file(GLOB shader "${bvhd_SHADER_DIR}/bvhd_ray_query.glsl")
message(STATUS "bvhd ${bvhd_VERSION}, shader ${shader}")
END
cat >project/tool.c <<'END'
#include <stdio.h>
#include <bvhd/bvhd.h>
int main(void)
{
    struct bvhd_client *client;
    struct bvhd_error error;
    const enum bvhd_status status = bvhd_client_create(NULL, &client, &error);
    printf("%s %s\n", bvhd_version(), bvhd_status_name(status));
    if (status == BVHD_OK)
        bvhd_client_destroy(client);
    return status != BVHD_OK;
}
END

# configure FOLDER OPTION... - configures the project in a new folder.
configure()
{
    folder=$1
    shift
    CC=$compiler cmake -S project -B "$folder" -DCMAKE_PREFIX_PATH="$scratch/moved" "$@"
}

version=$(sed -n 's/^Version: //p' "$(find moved -name bvhd.pc)")
expect 'a version' [ -n "$version" ]
expect_quietly 'the project is configured' configure build
expect 'it knows the version and the shaders' \
    grep -q "bvhd $version, shader $scratch/moved/.*/bvhd_ray_query.glsl" log
expect_quietly 'it is built' cmake --build build
for kind in bvhd bvhd_static; do
    expect_quietly "the program with bvhd::$kind" "./build/tool_$kind"
    expect "it has the library's version" grep -qx "$version OK" log
done
expect 'bvhd::bvhd is the moved library' \
    sh -c "ldd build/tool_bvhd | grep -q 'libbvhd.so.0 => $scratch/moved/'"
expect 'bvhd::bvhd_static needs none' sh -c '! ldd build/tool_bvhd_static | grep -q libbvhd'

# Versions and headers are decided again in the same folder, so that the compiler is not tested again.
expect_quietly 'its own version will do' configure build -DWANTED="$version"
expect 'a version of another major number will not' sh -c "! cmake build -DWANTED=99.0 >log 2>&1"
expect "cmake names the version that it found: $(tail -n 9 log)" grep -q "version: $version" log
expect 'no Vulkan, no package' \
    sh -c "! cmake build -DWANTED= -Dbvhd_VULKAN_INCLUDE_DIR=bvhd_VULKAN_INCLUDE_DIR-NOTFOUND \
        -DCMAKE_FIND_USE_CMAKE_SYSTEM_PATH=OFF -DCMAKE_FIND_USE_SYSTEM_ENVIRONMENT_PATH=OFF >log 2>&1"
expect "it says what is missing: $(tail -n 9 log)" grep -q 'vulkan/vulkan_core.h' log

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
