#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# python.sh SOURCE BUILD COMPILER... - tests the Python package: the tests of tests/python with a daemon, the types by
# mypy, an installation by pip, and the session of docs/python.md, whose bytes are those of the C program of
# docs/library.md. It prints each expectation that does not hold and says what it left out. Its status is 1 if an
# expectation does not hold, and 77 where no Python has numpy.
# shellcheck disable=SC2046,SC2086 # compilers and flags are lists of words
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
# shellcheck source=tests/support/installed.sh
. "$(dirname "$0")/../support/installed.sh"

python=
for candidate in python3 /usr/bin/python3; do
    [ -n "$python" ] || ! "$candidate" -c 'import numpy' 2>/dev/null || python=$candidate
done
[ -n "$python" ] || { echo 'skipped: all expectations of the Python package, for lack of python3-numpy'; exit 77; }

export PYTHONDONTWRITEBYTECODE=1 PYTHONPATH="$source/client/python" BVHD_SOCKET="$scratch/s.sock"
export BVHD_LIBRARY="$build/client/libbvhd.so.0" BVHD_CC="$compiler"
BVHD_CFLAGS="-I$source/client/include -I$source/proto/include $(pkg-config --cflags vulkan)"
export BVHD_CFLAGS
"$build/daemon/bvhd" --socket "$scratch/s.sock" --no-cache >daemon.log 2>&1 &
daemon=$!
expect_quietly "a daemon: $(cat daemon.log)" "$build/client/bvhctl/bvhctl" --connect-timeout 30 ping
cat >two.gltf <<'END'
{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
 "nodes": [{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 5]}],
 "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
 "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0],
                "max": [1, 1, 0]}],
 "bufferViews": [{"buffer": 0, "byteLength": 36}],
 "buffers": [{"byteLength": 36,
              "uri": "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]}
END
export BVHD_CONTAINER="$scratch/two.bvhd"
expect_quietly 'a container' "$build/client/bvhctl/bvhctl" build two.gltf -o "$BVHD_CONTAINER"
for name in test_structs test_client test_local test_cpu test_round test_motion; do
    # Warnings, such as those about files that are not closed, are errors.
    expect_quietly "tests/python/$name.py" env -C "$source/tests/python" "$python" -W error -m unittest $name
    expect "$name has tests" grep -q '^Ran [1-9]' log
done

# The session of the documentation. The library says what the C program has in its result.
sed -n '/^```python$/,/^```$/{/^```/!p}' "$source/docs/python.md" >session.py
expect "docs/python.md has a session of ten lines ($(wc -l <session.py))" [ "$(wc -l <session.py)" -eq 10 ]
sed -n '/^```c$/,/^```$/{/^```/!p}' "$source/docs/library.md" >example.c
sed 's/printf("%lu bytes.*$/fwrite(result->data, 1, result->size, stdout);/' example.c >bytes.c
expect_quietly 'the C program' $compiler bytes.c -o bytes $BVHD_CFLAGS -L"$build/client" -lbvhd
expect 'it runs' sh -c "LD_LIBRARY_PATH='$build/client' ./bytes >triangle.c.as"
expect_quietly 'the session' "$python" -W error::UserWarning session.py
expect "it prints the size: $(cat log)" grep -qx '352 bytes' log
expect 'its bytes are those of the C program' cmp triangle.as triangle.c.as
mkdir alone
expect_quietly 'the session without a daemon' env -C alone BVHD_SOCKET="$scratch/none" "$python" ../session.py
expect 'it has the same triangle' cmp triangle.as alone/triangle.as
expect 'it has the same scene' cmp scene.as alone/scene.as
expect_quietly 'bvhctl reads its structure' "$build/client/bvhctl/bvhctl" inspect scene.as

# Installed by pip, without a network and without a compiler.
version=$(sed -n "s/^ *version: '\([0-9.]*\)',\$/\1/p" "$source/meson.build" | head -n 1)
if "$python" -c 'import setuptools, pip, wheel' 2>/dev/null; then
    cp -R "$source/client/python" package
    expect_quietly 'pip install' env CC=false "$python" -m pip --disable-pip-version-check install --no-index \
        --no-build-isolation --no-deps --quiet --target "$scratch/installed" ./package
    expect_quietly 'the installed package' env PYTHONPATH="$scratch/installed" "$python" -c \
        'import bvhd, sys; sys.exit(not bvhd.__file__.startswith(sys.argv[1]))' "$scratch/installed"
    expect 'it says that it has types' [ -e installed/bvhd/py.typed ]
    expect 'its metadata say Linux' grep -q 'Operating System :: POSIX :: Linux' installed/bvhd-*.dist-info/METADATA
    expect "its version is $version" grep -qx "Version: $version" installed/bvhd-*.dist-info/METADATA
else
    echo 'skipped: 5 expectations of the installed package, for lack of python3-pip, -setuptools or -wheel'
fi
expect_quietly 'without the library it says what to do' sh -c \
    "! env BVHD_LIBRARY= LD_LIBRARY_PATH= '$python' -c 'import bvhd' 2>said || grep -q 'libbvhd' /proc/self/maps"
[ ! -s said ] || expect "it names the variable: $(tail -n 1 said)" grep -q 'ImportError.*BVHD_LIBRARY' said

if command -v mypy >/dev/null; then
    expect_quietly 'mypy' mypy --strict --python-executable "$(command -v "$python")" \
        --cache-dir "$build/mypy-cache" "$source/client/python/bvhd"
else
    echo 'skipped: 1 expectation of the types, for lack of mypy'
fi

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
