#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# cpp_header.sh SOURCE BUILD - compiles cpp_header.cpp, which uses the C++ headers of the library, as C++17 and C++20
# with g++ and clang++, with exceptions and without, and runs it with a daemon. It prints each expectation that does not
# hold, and its status is 1 if there is one; 77 where there is no C++ compiler.
# shellcheck disable=SC2086 # options are lists of words
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
# shellcheck source=tests/support/installed.sh
. "$(dirname "$0")/../support/installed.sh"

flags="-Wall -Wextra -Werror -pedantic -Wconversion -Wshadow -I$source/client/include -I$source/proto/include \
$(pkg-config --cflags vulkan)"
LD_LIBRARY_PATH=$build/client
export LD_LIBRARY_PATH BVHD_SOCKET="$scratch/s.sock"
"$build/daemon/bvhd" --socket "$scratch/s.sock" --no-cache >daemon.log 2>&1 &
daemon=$!
expect_quietly "a daemon: $(cat daemon.log)" "$build/client/bvhctl/bvhctl" --connect-timeout 30 ping

cat >triangle.ply <<'END'
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
END
expect_quietly 'a container' "$build/client/bvhctl/bvhctl" build triangle.ply -o triangle.bvhd

for cxx in g++ clang++; do
    command -v $cxx >/dev/null || { echo "skipped: 6 expectations of $cxx, which is missing"; continue; }
    # Each header compiles alone.
    for header in "$source"/client/include/bvhd/*.hpp; do
        expect_quietly "${header##*/} with $cxx" $cxx -std=c++17 $flags -fsyntax-only -x c++ "$header"
    done
    expect_quietly "C++20 with $cxx" $cxx -std=c++20 $flags -fsyntax-only "$source/tests/integration/cpp_header.cpp"
    for kind in '' '-fno-exceptions -fno-rtti'; do
        expect_quietly "$cxx $kind" $cxx -std=c++17 $flags $kind "$source/tests/integration/cpp_header.cpp" -o program \
            -L"$build/client" -lbvhd
        expect_quietly "the program of $cxx $kind" ./program triangle.bvhd
        expect "it says what it did: $(cat log)" grep -qE '^[1-9][0-9]* expectations hold$' log
    done
done
[ $checks -gt 1 ] || exit 77

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
