#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# house_rules.sh ROOT - the rules of the house that no compiler checks: includes point one way, each foreign library has its door, every
# source says its licence, no file grows too long, ARCHITECTURE.md names every header. Prints what breaks them; status 1 when anything does.
# house_rules.sh --self-test - breaks each rule in a scratch tree and fails unless that is found.
set -eu

# The part of the house that a file belongs to.
room()
{
    case $1 in
    proto/*) echo proto ;;
    builder/format/*) echo format ;;
    builder/*) echo builder ;;
    client/bvhctl/*) echo bvhctl ;;
    client/*) echo client ;;
    daemon/*) echo daemon ;;
    *) echo tests ;;
    esac
}

# may_include FROM TO - rooms
may_include()
{
    case $1 in
    proto) [ "$2" = proto ] ;;
    format) [ "$2" = proto ] || [ "$2" = format ] ;;
    builder) [ "$2" = proto ] || [ "$2" = format ] || [ "$2" = builder ] ;;
    client) [ "$2" = proto ] || [ "$2" = client ] ;;
    daemon) [ "$2" != client ] && [ "$2" != bvhctl ] && [ "$2" != tests ] ;;
    bvhctl) [ "$2" != daemon ] && [ "$2" != tests ] ;;
    esac
}

# door HEADER - the only files (a pattern) that may include a foreign header; nothing for one that is free to all.
door()
{
    case $1 in
    embree[0-9]/*) echo 'builder/embree.c' ;;
    openssl/*) echo 'builder/content_key.c' ;;
    assimp/* | png.h | cjson/* | cJSON.h) echo 'client/bvhctl/*' ;;
    vulkan/*) echo 'client/*' ;;
    esac
}

complain()
{
    echo "$*"
    echo x >>"$scratch/complaints"
}

sources()
{
    find proto builder client daemon -name '*.[ch]' -o -name '*.def' | sort
}

# "FILE HEADER" for each include in quotes or brackets.
includes()
{
    sources | while read -r file; do
        sed -n 's/^[ 	]*#[ 	]*include[ 	]*[<"]\([^>"]*\)[>"].*/\1/p' "$file" | sed "s|^|$file |"
    done
}

check_includes()
{
    sources | sed 's|^\(.*\)/\([^/]*\)$|\2 \1/\2|' >"$scratch/places"
    includes | while read -r file header; do
        allowed=$(door "$header")
        # shellcheck disable=SC2254 # a pattern
        case $file in
        ${allowed:-*}) ;;
        *) complain "$file: $header may be included by $allowed only" ;;
        esac
        awk -v name="${header##*/}" '$1 == name { print $2 }' "$scratch/places" >"$scratch/found"
        while read -r place; do
            case $place in *"$header") ;; *) continue ;; esac
            may_include "$(room "$file")" "$(room "$place")" || complain "$file: includes $place, against the direction"
        done <"$scratch/found"
    done
}

check_files()
{
    { sources; find tests -name '*.[ch]'; } | while read -r file; do
        head -n 1 "$file" | grep -q 'SPDX-License-Identifier: Apache-2.0' || complain "$file: no SPDX line at its head"
        [ "$(wc -l <"$file")" -lt 600 ] || complain "$file: 600 lines or more"
        ! grep -q ' $' "$file" || complain "$file: spaces at a line's end"
    done
}

check_headers()
{
    sources | sed -n 's|.*/\(.*\)\.h$|\1|p' | while read -r module; do
        grep -q "\`$module\(\.h\)\{0,1\}\`" ARCHITECTURE.md || complain "$module.h: ARCHITECTURE.md does not name it"
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
    echo '`low` `middle` `high.h` `beside` `embree` `a`' >"$tree/ARCHITECTURE.md"
    for place in proto/low builder/format/middle builder/high client/beside; do
        echo "$spdx" >"$tree/$place.h"
    done
    printf '%s\n#include "low.h"\n#include "middle.h"\n#include <embree3/rtcore.h>\n' "$spdx" >"$tree/builder/embree.c"
    (check_house "$tree") || { echo "a good tree was refused"; exit 1; }
    printf '%s\n#include "middle.h"\n' "$spdx" >"$tree/proto/a.c" && must_fail 'proto to format' proto/a.c
    printf '%s\n# include "high.h"\n' "$spdx" >"$tree/builder/format/a.c" && must_fail 'format to builder' builder/format/a.c
    printf '%s\n#include "beside.h"\n' "$spdx" >"$tree/builder/a.c" && must_fail 'builder to client' builder/a.c
    printf '%s\n#include "high.h"\n' "$spdx" >"$tree/client/a.c" && must_fail 'client to builder' client/a.c
    printf '%s\n#include "beside.h"\n' "$spdx" >"$tree/daemon/a.c" && must_fail 'daemon to client' daemon/a.c
    printf '%s\n#include <embree3/rtcore.h>\n' "$spdx" >"$tree/builder/a.c" && must_fail "Embree's door" builder/a.c
    printf '%s\n#include <openssl/evp.h>\n' "$spdx" >"$tree/builder/a.c" && must_fail "OpenSSL's door" builder/a.c
    printf '%s\n#include <vulkan/vulkan_core.h>\n' "$spdx" >"$tree/builder/a.c" && must_fail "Vulkan's door" builder/a.c
    printf '%s\n#include <png.h>\n' "$spdx" >"$tree/client/a.c" && must_fail "libpng's door" client/a.c
    echo 'int x;' >"$tree/tests/a.c" && must_fail 'no licence' tests/a.c
    { echo "$spdx" && yes 'int x;' | head -n 600; } >"$tree/proto/a.c" && must_fail 'a long file' proto/a.c
    echo "$spdx" >"$tree/proto/b.h" && must_fail 'a header that is not described' proto/b.h
    printf '%s\nint x; \n' "$spdx" >"$tree/proto/a.c" && must_fail 'a space at the end' proto/a.c
}

case ${1-} in
--self-test) self_test ;;
?*) check_house "$1" ;;
*) echo "usage: house_rules.sh ROOT | --self-test" >&2; exit 2 ;;
esac
