#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# libbvhd.sh SOURCE BUILD COMPILER... - installs the client library below a scratch folder and tests it as other
# programs use it: headers, exported names, dependencies, both kinds of linking, and the example of docs/library.md
# against a real daemon. COMPILER includes the options of sanitizers, if any. It prints each expectation that does not
# hold, and its status is 1 if there is one.
# shellcheck disable=SC2016,SC2046,SC2086 # compilers and flags are lists of words
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
# shellcheck source=tests/support/installed.sh
. "$(dirname "$0")/../support/installed.sh"

expect_quietly 'meson install, with a file for pkg-config' install_library
[ $failures -eq 0 ] || exit 1
include=$(pkg --variable=includedir)
libraries=$(pkg --variable=libdir)
shared=$libraries/libbvhd.so
static=$libraries/libbvhd.a
# The installed files are those of installed.list, where PYTHON is the folder of Python's packages, the manual pages of
# section 3, which manuals3.sh tests, and byte code, which newer versions of meson compile.
version=$(pkg --modversion)
libdir=${libraries#"$prefix/"}
(cd "$prefix" && find . ! -type d | sed -E "s|^[.]/||; s|^$libdir/|LIBDIR/|; s|[.]$version\$|.VERSION|
    s|^lib/python3[.0-9]*/[a-z]*-packages/|PYTHON/|") |
    grep -vE '^share/man/man3/|/__pycache__/' | sort >installed
[ -d "$prefix/lib/systemd" ] && units=none || units='^lib/(systemd|sysusers.d|tmpfiles.d)/|^etc/'
grep -vE "$units" "$source/tests/integration/installed.list" | diff - installed >changed
expect "installed, but not in installed.list (>), or the other way round (<): $(cat changed)" [ ! -s changed ]
# Each of them is in a Debian package, or listed as being in none.
is_packaged()
{
    for pattern in $patterns; do
        # shellcheck disable=SC2254 # they are patterns
        case $1 in
        $pattern | $pattern/*) return 0 ;;
        esac
    done
    return 1
}
set -f
patterns=$(cat "$source"/debian/not-installed $(find "$source/debian" -name '*.install') | sed 's/^#.*//; s/ .*//')
sed 's|^LIBDIR/|lib/here/|; s|^PYTHON/|lib/python3/|; /^etc[/]/!s|^|usr/|' installed >paths
while read -r path; do
    expect "a package of debian/ has $path" is_packaged "$path"
done <paths
set +f
expect_quietly 'pkg-config asks for the headers' sh -c "echo '$(pkg --cflags)' | grep -q -- '-I$include'"
expect_quietly 'pkg-config asks for the library alone' \
    sh -c "echo ' $(pkg --libs) ' | grep -Eq '^ *(-L[^ ]+ +)?-lbvhd *$'"
expect_quietly 'the version is the one that the library has' \
    sh -c "'$prefix/bin/bvhctl' --version | grep -q ' $(pkg --modversion)\$'"

# The library exports the functions of its headers and no others. It needs no library of the builder or the daemon.
cat "$include"/bvhd/*.h | grep '^BVHD_API' | grep -o 'bvhd_[a-z_0-9]*(' | tr -d '(' | sort >declared
nm -D --defined-only "$shared" | awk '$2 != "A" { sub(/@.*/, "", $3); print $3 }' | grep -v '^_*asan\|^__odr' |
    sort >exported
nm -g --defined-only "$static" | awk 'NF == 3 { print $3 }' | grep -v '^_*asan\|^__odr' | sort >exported_static
expect_quietly 'functions are declared' [ "$(wc -l <declared)" -gt 25 ]
expect_quietly 'the shared library exports what is declared' diff declared exported
expect_quietly 'so does the static one' diff declared exported_static
# The Debian package lists the same names, and has the same version.
sed -n 's/^ \(bvhd_.*\)@BVHD_0 .*/\1/p' "$source/debian/libbvhd0.symbols" | sort >packaged
expect_quietly 'debian/libbvhd0.symbols has what is declared' diff declared packaged
packaged=$(sed -n '1s/.*(\(.*\)-.*/\1/p' "$source/debian/changelog")
expect "the version in debian/changelog, $packaged, is $version" [ "$packaged" = "$version" ]
# Unit tests have tables of wrong calls, which have every function.
cat "$source"/tests/unit/client/test_misuse.c "$source"/tests/unit/client/vulkan/test_vulkan_misuse.c |
    grep -o 'bvhd_[a-z_0-9]*(' | tr -d '(' | sort -u | comm -23 declared - >unmisused
expect "functions that no wrong call is made of: $(tr '\n' ' ' <unmisused)" [ ! -s unmisused ]
expect_quietly 'its name' sh -c "readelf -d '$shared' | grep -q 'SONAME.*\\[libbvhd.so.0\\]'"
nm -D --defined-only "$libraries/libbvhd_build.so.0" | awk '$2 != "A" { sub(/@.*/, "", $3); print $3 }' |
    grep -v '^_*asan\|^__odr' >exported_build
expect_quietly 'the builder exports one function' [ "$(cat exported_build)" = bvhd_build_library ]
ldd "$shared" >needed
for foreign in libuv embree crypto ssl tbb stdc++ assimp vulkan systemd; do
    expect_quietly "no $foreign among what it needs" sh -c "! grep -i '$foreign' needed"
done
expect_quietly 'no writable and executable pages' sh -c "! readelf -lW '$shared' | grep -E 'GNU_STACK.*E|TEXTREL'"

# The headers compile in several languages, and with another version of vulkan.h.
echo '#include <vulkan/vulkan_core.h>' >where.c
vulkan=$($compiler $(pkg --cflags) -E where.c | sed -n 's/^# 1 "\(.*vulkan_core\.h\)".*/\1/p' | head -n 1)
mkdir -p newer/vulkan
awk '/^#define VK_HEADER_VERSION [0-9]/ { print "#define VK_HEADER_VERSION", $3 + 61; next }
    /^#ifdef __cplusplus/ && !done {
        print "#define VK_NEW_acceleration 1"
        print "typedef struct VkNewAcceleration { int sType; } VkNewAcceleration;"
        done = 1
    }
    { print }' "$vulkan" >newer/vulkan/vulkan_core.h
expect_quietly 'another vulkan_core.h' \
    sh -c "grep -q VkNewAcceleration newer/vulkan/vulkan_core.h && ! cmp -s '$vulkan' newer/vulkan/vulkan_core.h"
cat >plain.c <<'END'
#include <bvhd/bvhd.h>
#include <bvhd/bvhd_cpu.h>
#include <bvhd/bvhd_micromap.h>
#include <bvhd/bvhd_scene.h>
#include <bvhd/bvhd_structure.h>
#include <bvhd/bvhd_trace.h>
#include <bvhd/bvhd_vulkan.h>
#include <bvhd/vulkan_khr.h>
#include <bvhd/vulkan_nv.h>
int use(struct bvhd_client *client);
int use(struct bvhd_client *client)
{
    struct bvhd_client_options options = {0};
    return bvhd_client_descriptor(client) + (int)options.pool_size + BVHD_VUID_COUNT + BVHD_OK;
}
END
sed 's/{0}/{}/; s/int use(struct bvhd_client \*client);//' plain.c >plain.cpp
{ printf '#include <vulkan/vulkan_core.h>\nVkNewAcceleration before;\n' && cat plain.c; } >beside.c
for standard in c99 c11 c17; do
    expect_quietly "the header in $standard" $compiler -std=$standard -pedantic -Wall -Wextra -Wconversion \
        -Wstrict-prototypes -Werror $(pkg --cflags) -c plain.c
done
expect_quietly 'the header beside a newer vulkan_core.h' $compiler -std=c99 -pedantic -Wall -Werror -Inewer \
    -I"$(dirname "$vulkan")" $(pkg --cflags) -c beside.c
for compiler_cpp in g++ clang++; do
    command -v $compiler_cpp >/dev/null || continue
    for standard in c++11 c++20; do
        expect_quietly "the header in $standard, $compiler_cpp" $compiler_cpp -std=$standard -pedantic -Wall -Wextra \
            -Werror $(pkg --cflags) -c plain.cpp
    done
done

# The example of docs/library.md is compiled with pkg-config's options, linked both ways, and run with a daemon and
# without any. It prints the size of the result; a variant of it writes the bytes.
sed -n '/^```c$/,/^```$/{/^```/!p}' "$source/docs/library.md" >example.c
expect_quietly "docs/library.md has an example of 30 lines ($(wc -l <example.c))" [ "$(wc -l <example.c)" -eq 30 ]
export LD_LIBRARY_PATH="$libraries"
expect_quietly 'the example, shared' $compiler -std=c99 -pedantic -Wall -Wextra -Werror example.c -o example \
    $(pkg --cflags --libs)
expect_quietly 'it uses the shared library' sh -c "ldd ./example | grep -q '$libraries/libbvhd.so.0'"
static_flags=$(pkg --static --libs | sed 's/-lbvhd/-l:libbvhd.a/')
expect_quietly 'the example, static' $compiler -std=c99 example.c -o example_static $(pkg --cflags) $static_flags
expect_quietly 'it needs no shared library' sh -c "! ldd ./example_static | grep libbvhd"

# A program may define every internal name of the library itself.
nm -g --defined-only "$build/client/libbvhd.o" | awk 'NF == 3 { print $3 }' | sort -u | comm -23 - declared |
    grep -v '^__\|\.' >inner
expect_quietly 'the library has inner names' grep -qx memory_alloc inner
{ echo '#include <stdlib.h>' && sed 's/.*/void &(void);\nvoid &(void) { abort(); }/' inner; } >names.c
expect_quietly 'a program with the same names, static' $compiler -fno-builtin -c names.c
expect_quietly 'it links' $compiler -std=c99 example.c names.o -o example_names $(pkg --cflags) $static_flags
expect_quietly 'shared, too' $compiler -std=c99 -rdynamic example.c names.o -o example_names_shared \
    $(pkg --cflags --libs)

# The example of bvhd_cpu.h traces what bvhctl has built, without a daemon; a broken file is refused by its place.
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n' >one.obj
expect_quietly 'a structure' "$prefix/bin/bvhctl" --local build one.obj -o one
for link in "$(pkg --libs)" "$static_flags"; do
    expect_quietly "trace_cpu.c $link" $compiler -std=c99 -pedantic -Wall -Wextra -Wconversion -Werror \
        "$source/client/examples/trace_cpu.c" -o trace_cpu $(pkg --cflags) $link
    ./trace_cpu one/*.as >picture 2>&1
    expect_quietly "a triangle: $(cat picture)" [ "$(tr -cd '#+' <picture | wc -c)" -eq 768 ]
    head -c 200 one/*.as >short.as
    ./trace_cpu short.as >picture 2>&1
    expect_quietly "a refusal: $(cat picture)" grep -q '^CORRUPT: blobs\[0\]: header.serializedSize: ' picture
done

sed 's/printf("%lu bytes.*/fwrite(result->data, 1, result->size, stdout);/' example.c >bytes.c
expect_quietly 'a variant of the example' grep -q 'fwrite(result->data' bytes.c
expect_quietly 'it is compiled' $compiler -std=c99 bytes.c -o bytes $(pkg --cflags --libs)

# run_example WHAT - runs each program of the example, which has to build.
run_example()
{
    for program in example example_static example_names example_names_shared; do
        ./$program >out 2>&1
        got=$?
        expect_quietly "$program builds $1: $(cat out)" grep -qx '[0-9]* bytes' out
        expect_quietly "status 0 of $program $1 ($got)" [ $got -eq 0 ]
    done
}

# There is no daemon anywhere: the programs build by libbvhd_build, which the static ones find by its name.
export TMPDIR="$scratch"
run_example 'without a daemon'
expect_quietly 'the bytes, without a daemon' sh -c './bytes >alone.as && [ "$(wc -c <alone.as)" -ge 352 ]'

# Hairs of linear swept spheres, whose structs an installed header declares where Vulkan's headers are older.
for link in "$(pkg --libs)" "$static_flags"; do
    expect_quietly "trace_hair.c $link" $compiler -std=c99 -pedantic -Wall -Wextra -Wconversion -Werror \
        "$source/client/examples/trace_hair.c" -o trace_hair $(pkg --cflags) $link
    ./trace_hair >hair 2>&1
    expect_quietly "rays hit hairs: $(tail -n 1 hair)" grep -qx '286 of 1536 rays hit a hair' hair
done

# A wing that moves, at sixteen times.
for link in "$(pkg --libs)" "$static_flags"; do
    expect_quietly "trace_motion.c $link" $compiler -std=c99 -pedantic -Wall -Wextra -Wconversion -Werror \
        "$source/client/examples/trace_motion.c" -o trace_motion $(pkg --cflags) $link
    ./trace_motion >motion 2>&1
    expect_quietly "rays hit the wing: $(tail -n 1 motion)" grep -qx '960 of 24576 rays hit the wing' motion
done

# The loop of updates, of which docs/library.md has the functions that update.
sed -n '/^## Updates$/,/^## /s/^    //p' "$source/docs/library.md" >quoted
sed -n '/^\/\* Makes the structure of the vertices/,/^int main/{/^int main/!{/^$/!p}}' \
    "$source/client/examples/update_loop.c" >functions
expect_quietly "update_loop.c has functions to quote ($(wc -l <functions))" [ "$(wc -l <functions)" -gt 30 ]
expect_quietly 'docs/library.md quotes them' diff functions quoted
for link in "$(pkg --libs)" "$static_flags"; do
    expect_quietly "update_loop.c $link" $compiler -std=c99 -pedantic -Wall -Wextra -Wconversion -Werror \
        "$source/client/examples/update_loop.c" -o update_loop $(pkg --cflags) $link -lm
    expect_quietly 'a loop of updates' sh -c './update_loop >loop'
    expect_quietly "it updates most frames, and builds some: $(tail -n 1 loop)" \
        grep -Eqx '24 frames: (1[2-9]|2[0-2]) updates, [0-9]+ builds' loop
done

export BVHD_SOCKET="$scratch/s.sock"
run_example 'where a daemon could be'
"$prefix/bin/bvhd" --socket "$BVHD_SOCKET" --no-cache >daemon.log 2>&1 &
daemon=$!
expect_quietly "a daemon: $(cat daemon.log)" "$prefix/bin/bvhctl" --connect-timeout 30 ping
run_example 'with a daemon'
expect_quietly 'the bytes, with a daemon' sh -c './bytes >served.as && cmp alone.as served.as'
expect_quietly 'the daemon has built' sh -c "'$prefix/bin/bvhctl' stats | grep -Eq '^builds_done +1$'"
expect_quietly 'the loop of updates is the same with a daemon' sh -c './update_loop >served && cmp loop served'
expect_quietly 'hairs are the same with a daemon' sh -c './trace_hair >served && cmp hair served'
expect_quietly 'what moves is the same with a daemon' sh -c './trace_motion >served && cmp motion served'
expect_quietly 'the daemon has updated' sh -c "'$prefix/bin/bvhctl' stats | grep -Eq '^refits_done +[1-9]'"
kill "$daemon"
wait "$daemon"
daemon=

# Without libbvhd_build, or with one of another version, the error says so.
mkdir lone
cp "$shared.0" lone
LD_LIBRARY_PATH=$scratch/lone ./example >out 2>&1
got=$?
expect_quietly "it names the library and the places: $(cat out)" \
    grep -q "^UNSUPPORTED: $scratch/lone/libbvhd_build.so.0: .*No such file.*libbvhd_build.so.0: cannot open" out
expect_quietly "status 1 without the library ($got)" [ $got -eq 1 ]
cat >other.c <<'END'
struct build_library {
    const char *version;
};
const struct build_library *bvhd_build_library(void);
const struct build_library *bvhd_build_library(void)
{
    static const struct build_library library = {"0.0.7"};
    return &library;
}
END
expect_quietly 'another version' $compiler -shared -fPIC other.c -o lone/libbvhd_build.so.0
LD_LIBRARY_PATH=$scratch/lone ./example >out 2>&1
got=$?
expect_quietly "it names both versions: $(cat out)" \
    grep -q "^INCOMPATIBLE: libbvhd_build.so.0: has version 0.0.7, but libbvhd $(pkg --modversion)" out
expect_quietly "status 1 with another version ($got)" [ $got -eq 1 ]

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
