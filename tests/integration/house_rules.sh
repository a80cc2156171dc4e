#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# house_rules.sh ROOT - the rules of the house that no compiler checks: includes point one way, each foreign library has its door, every
# source says its licence, no file grows too long, ARCHITECTURE.md names every header. Prints what breaks them; status 1 when anything does.
# house_rules.sh --self-test - breaks each rule in a scratch tree and fails unless that is found.
# shellcheck disable=SC2016 # awk's dollars are not the shell's
set -eu

sources()
{
    find proto builder client daemon -name '*.[ch]' -o -name '*.def' | sort
}

complain()
{
    echo "$*"
    echo x >>"$scratch/complaints"
}

# "FILE HEADER" for each include in quotes or brackets.
includes()
{
    sources | xargs awk '
        /^[ \t]*#[ \t]*include[ \t]*[<"]/ {
            sub(/^[^<"]*[<"]/, "")
            sub(/[>"].*/, "")
            print FILENAME, $0
        }'
}

# Which room of the house may include which, and the only files that may include the headers of a foreign library.
check_includes()
{
    { sources | sed 's/^/source /'; includes | sed 's/^/include /'; } | awk '
        BEGIN {
            may["proto"] = "proto"
            may["format"] = "proto format"
            may["builder"] = "proto format builder"
            may["client"] = "proto format client"
            may["daemon"] = "proto format builder daemon"
            may["bvhctl"] = "proto format builder client bvhctl"
            door["embree[0-9]/"] = "tests/bench/"
            door["openssl/"] = "builder/content_key.c"
            door["assimp/|png.h|cjson/|cJSON.h"] = "client/bvhctl/"
            door["vulkan/"] = "client/"
            door["uv.h|uv/"] = "daemon/"
            door["systemd/"] = "daemon/"
            door["protobuf-c/|[a-z_]*[.]pb-c[.]h"] = "proto/control"
        }
        function room(file) {
            if (file ~ /^builder\/format\//) return "format"
            if (file ~ /^client\/bvhctl\//) return "bvhctl"
            sub(/\/.*/, "", file)
            return file
        }
        function base(path) {
            sub(/.*\//, "", path)
            return path
        }
        $1 == "source" { places[base($2)] = places[base($2)] " " $2 }
        $1 == "include" {
            for (library in door)
                if ($3 ~ "^(" library ")" && index($2, door[library]) != 1)
                    print $2 ": " $3 " may be included by " door[library] " only"
            count = split(places[base($3)], found, " ")
            for (i = 1; i <= count; i++)
                if (substr(found[i], length(found[i]) - length($3) + 1) == $3 && index(" " may[room($2)] " ", " " room(found[i]) " ") == 0)
                    print $2 ": includes " found[i] ", against the direction"
        }' >"$scratch/includes"
    while read -r line; do
        complain "$line"
    done <"$scratch/includes"
}

check_files()
{
    { sources; find tests -name '*.[ch]'; } | xargs awk '
        function finish() { if (lines >= 600) print file ": 600 lines or more" }
        FNR == 1 {
            finish()
            file = FILENAME
            if ($0 !~ /SPDX-License-Identifier: Apache-2.0/) print file ": no SPDX line at its head"
        }
        / $/ { print file ":" FNR ": a space at the end of the line" }
        { lines = FNR }
        END { finish() }' >"$scratch/files"
    while read -r line; do
        complain "$line"
    done <"$scratch/files"
}

# A header is named by itself, or belongs to a module whose name it begins with: `bins` stands for bins_kernels.h too.
check_headers()
{
    sources | sed -n 's|.*/\(.*\)\.h$|\1|p' | while read -r header; do
        module=$header
        until grep -q "\`$module\(\.h\)\{0,1\}\`" ARCHITECTURE.md; do
            case $module in
            *_*) module=${module%_*} ;;
            *) complain "$header.h: ARCHITECTURE.md does not name it"; break ;;
            esac
        done
    done
}

check_house()
{
    cd "$1"
    scratch=$(mktemp -d)
    trap 'rm -rf "$scratch"' EXIT
    : >"$scratch/complaints"
    check_includes
    check_files
    check_headers
    [ ! -s "$scratch/complaints" ]
}

# must_fail WHAT - the scratch tree with one more file has to be refused, then the file goes.
must_fail()
{
    if (check_house "$tree") >/dev/null; then
        echo "not found: $1"
        exit 1
    fi
    rm "$tree/$2"
    (check_house "$tree") || { echo "found after it had gone: $1"; exit 1; }
}

self_test()
{
    tree=$(mktemp -d)
    trap 'rm -rf "$tree"' EXIT
    spdx='/* SPDX-License-Identifier: Apache-2.0 */'
    mkdir -p "$tree/proto" "$tree/builder/format" "$tree/client/bvhctl" "$tree/daemon" "$tree/tests"
    # shellcheck disable=SC2016 # these are quotation marks of the text
    echo '`low` `middle` `high.h` `beside` `a`' >"$tree/ARCHITECTURE.md"
    for place in proto/low builder/format/middle builder/high client/beside; do
        echo "$spdx" >"$tree/$place.h"
    done
    printf '%s\n#include "low.h"\n#include "middle.h"\n#include <openssl/evp.h>\n' "$spdx" >"$tree/builder/content_key.c"
    (check_house "$tree") || { echo "a good tree was refused"; exit 1; }
    printf '%s\n#include "middle.h"\n' "$spdx" >"$tree/proto/a.c" && must_fail 'proto to format' proto/a.c
    printf '%s\n# include "high.h"\n' "$spdx" >"$tree/builder/format/a.c" && must_fail 'format to builder' builder/format/a.c
    printf '%s\n#include "beside.h"\n' "$spdx" >"$tree/builder/a.c" && must_fail 'builder to client' builder/a.c
    printf '%s\n#include "high.h"\n' "$spdx" >"$tree/client/a.c" && must_fail 'client to builder' client/a.c
    printf '%s\n#include "middle.h"\n' "$spdx" >"$tree/client/a.c"
    (check_house "$tree") || { echo "client to format was refused"; exit 1; }
    printf '%s\n#include "beside.h"\n' "$spdx" >"$tree/builder/format/a.c" && must_fail 'format to client' builder/format/a.c
    printf '%s\n#include "beside.h"\n' "$spdx" >"$tree/daemon/a.c" && must_fail 'daemon to client' daemon/a.c
    printf '%s\n#include <embree3/rtcore.h>\n' "$spdx" >"$tree/builder/a.c" && must_fail "Embree's door" builder/a.c
    printf '%s\n#include <openssl/evp.h>\n' "$spdx" >"$tree/builder/a.c" && must_fail "OpenSSL's door" builder/a.c
    printf '%s\n#include <vulkan/vulkan_core.h>\n' "$spdx" >"$tree/builder/a.c" && must_fail "Vulkan's door" builder/a.c
    printf '%s\n#include <png.h>\n' "$spdx" >"$tree/client/a.c" && must_fail "libpng's door" client/a.c
    printf '%s\n#include <uv.h>\n' "$spdx" >"$tree/client/a.c" && must_fail "libuv's door" client/a.c
    printf '%s\n#include <systemd/sd-daemon.h>\n' "$spdx" >"$tree/client/a.c" && must_fail "systemd's door" client/a.c
    printf '%s\n#include <protobuf-c/protobuf-c.h>\n' "$spdx" >"$tree/proto/a.c" && must_fail "protobuf-c's door" proto/a.c
    printf '%s\n#include "bvhd.pb-c.h"\n' "$spdx" >"$tree/daemon/a.c" && must_fail 'the door of generated messages' daemon/a.c
    echo 'int x;' >"$tree/tests/a.c" && must_fail 'no licence' tests/a.c
    { echo "$spdx" && yes 'int x;' | head -n 600; } >"$tree/proto/a.c" && must_fail 'a long file' proto/a.c
    echo "$spdx" >"$tree/proto/b.h" && must_fail 'a header that is not described' proto/b.h
    echo "$spdx" >"$tree/proto/low_part.h" && (check_house "$tree") && rm "$tree/proto/low_part.h"
    printf '%s\nint x; \n' "$spdx" >"$tree/proto/a.c" && must_fail 'a space at the end' proto/a.c
}

case ${1-} in
--self-test) self_test ;;
?*) check_house "$1" ;;
*) echo "usage: house_rules.sh ROOT | --self-test" >&2; exit 2 ;;
esac
