#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# house_rules.sh ROOT - the rules of the house that no compiler checks: includes are paths from the root and point one
# way, each foreign library has its door, every source says its licence, no line has more than 120 columns (Python: 100)
# and no file 600 lines or more, every header is named by the README of its folder, links and names in documents lead
# somewhere, and the picture of the folders agrees with their table. Prints what breaks them; status 1 when anything
# does.
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

# "FILE HEADER quoted|bracketed" for each include.
includes()
{
    sources | xargs awk '
        /^[ \t]*#[ \t]*include[ \t]*[<"]/ {
            kind = /^[^<]*"/ ? "quoted" : "bracketed"
            sub(/^[^<"]*[<"]/, "")
            sub(/[>"].*/, "")
            print FILENAME, $0, kind
        }'
}

# The folders, and what each may include beside itself. A name that ends in ".h" is one header of a folder whose other
# headers stay closed. Lower rows know upper ones; a row may go on in the next line, which begins with spaces. A folder
# that is missing here is a complaint.
folders()
{
    sed -e ':join' -e '$!N' -e 's/\n  */ /' -e 't join' -e 'P' -e 'D' <<'END'
proto/base
proto/wire                  proto/base
builder/format              proto/base
builder/traverse            proto/base builder/format
builder/kernel              proto/base builder/format
builder/input               proto/base builder/format builder/kernel builder/context.h
builder/piece               proto/base builder/format builder/kernel
builder/wide                proto/base builder/format
builder/micromap            proto/base builder/format builder/context.h
builder/top                 proto/base builder/format builder/kernel builder/input builder/piece builder/wide
builder                     proto/base builder/format builder/kernel builder/input builder/piece builder/wide
                            builder/top
builder/update              proto/base builder/format builder/kernel builder/input builder
builder/local               proto/base builder/format builder/input builder builder/update
builder/store               proto/base
daemon/system               proto/base
daemon/pool                 proto/base
daemon/service              proto/base proto/wire builder/format builder/input builder builder/store builder/update
                            daemon/system daemon/pool
daemon/session              proto/base proto/wire builder/input builder daemon/system daemon/service
daemon/socket               proto/base proto/wire daemon/system daemon/service daemon/session
daemon                      proto/base daemon/system daemon/pool daemon/service daemon/socket
client                      proto/base proto/wire builder/format builder/local
client/cpu                  proto/base builder/format builder/traverse client
client/shaders
client/structure            proto/base builder/format client
client/vulkan               proto/base builder/format client client/shaders
client/examples             client
client/bvhctl/kernels
client/bvhctl/base          proto/base
client/bvhctl/oracle        proto/base builder/traverse/ray.h client/bvhctl/base
client/bvhctl/service       proto/base builder builder/store builder/update client client/bvhctl/base
client/bvhctl/gpu           proto/base builder/format client/vulkan client/bvhctl/base
client/bvhctl/scene         proto/base builder/format builder/traverse/ray.h builder/traverse/motion.h builder/input
                            builder/update/decay.h client/bvhctl/base client/bvhctl/oracle client/bvhctl/service
client/bvhctl/trace         proto/base builder/format builder/traverse/ray.h client/bvhctl/base client/bvhctl/gpu
                            client/bvhctl/scene client/bvhctl/kernels
client/bvhctl/picture       proto/base client/bvhctl/base client/bvhctl/oracle client/bvhctl/scene client/bvhctl/trace
client/bvhctl               proto/base builder/format builder/store client/bvhctl/base client/bvhctl/oracle
                            client/bvhctl/service client/bvhctl/gpu client/bvhctl/scene client/bvhctl/trace
                            client/bvhctl/picture
END
}

# The only files that may include the headers of a foreign library: a pattern of headers, and how the paths of its users
# begin.
doors()
{
    cat <<'END'
embree[0-9]/ builder/piece/embree_version.h
openssl/ builder/content_key.c
meshoptimizer.h client/bvhctl/scene/gltf_meshopt.c
jpeglib.h client/bvhctl/scene/image_jpeg.c
assimp/|png.h|cjson/|cJSON.h client/bvhctl/
vulkan/ client/
uv.h|uv/ daemon/
systemd/ daemon/
xxhash[.]h|xxh_x86dispatch[.]h builder/store/
protobuf-c/|[a-z_/]*[.]pb-c[.]h proto/wire/control
END
}

# Includes in quotes are paths from the root; but public headers and examples are compiled elsewhere, by others, and
# include what is beside them. Headers in <bvhd/> are public: proto/include is for everybody, client/include for the
# client.
check_includes()
{
    {
        folders | sed 's/^/folder /'
        doors | sed 's/^/door /'
        sources | sed 's/^/source /'
        includes | sed 's/^/include /'
    } | awk '
        function folder_of(path) {
            sub(/[/][^/]*$/, "", path)
            return path
        }
        $1 == "folder" {
            known[$2] = 1
            for (i = 3; i <= NF; i++)
                may[$2, $i] = 1
        }
        $1 == "door" { door[$2] = $3 }
        $1 == "source" {
            exists[$2] = 1
            if (!(folder_of($2) in known) && $2 !~ /[/]include[/]/)
                print $2 ": its folder is not in the table of folders"
        }
        $1 == "include" {
            for (library in door)
                if ($3 ~ "^(" library ")" && index($2, door[library]) != 1)
                    print $2 ": " $3 " may be included by " door[library] " only"
            from = folder_of($2)
            if ($3 ~ /^bvhd[/]/) {
                if ("client/include/" $3 in exists && from !~ /^client/)
                    print $2 ": includes " $3 ", which is the client\047s"
            } else if ($4 == "quoted" && from != "client/examples" && from !~ /[/]include[/]/) {
                to = folder_of($3)
                if (!($3 in exists) && !(to in known) && to !~ /^client[/](bvhctl|shaders)/)
                    print $2 ": " $3 " is no path from the root"
                else if (to != from && !((from, to) in may) && !((from, $3) in may))
                    print $2 ": includes " $3 ", against the direction"
            }
        }' >"$scratch/includes"
    while read -r line; do
        complain "$line"
    done <"$scratch/includes"
}

# Everything that is written by hand and read by people as code.
written()
{
    sources
    find tests -name '*.[ch]'
    find client tests -name '*.py' -o -name '*.[ch]pp'
    find client tests -type f | grep -E '\.(glsl|comp|rgen|rmiss|rchit|rahit|rint)$'
    find . -path ./build -prune -o \( -name '*.sh' -o -name meson.build \) -print | sed 's|^\./||'
    find . -maxdepth 1 \( -name check -o -name demo \) | sed 's|^\./||'
    find . -maxdepth 2 -path './debian/*' \( -name rules -o -name '*.p*' \) | sed 's|^\./||'
}

check_files()
{
    written | xargs awk '
        function finish() { if (lines >= 600) print file ": 600 lines or more" }
        FNR == 1 {
            finish()
            file = FILENAME
            limit = FILENAME ~ /[.]py$/ ? 100 : 120
            if (FILENAME ~ /[.]([ch]|[ch]pp|py)$/ && $0 !~ /SPDX-License-Identifier: Apache-2.0/)
                print file ": no SPDX line at its head"
        }
        / $/ { print file ":" FNR ": a space at the end of the line" }
        length > limit { print file ":" FNR ": more than " limit " columns" }
        { lines = FNR }
        END { finish() }' >"$scratch/files"
    while read -r line; do
        complain "$line"
    done <"$scratch/files"
}

# A header is named by the README of its folder, by itself or by the module whose name it begins with: `bins` stands for
# bins_kernels.h too.
check_headers()
{
    sources | grep '\.h$' | awk '
        # Returns whether the README of the folder exists, and collects the names that it quotes.
        function read_names(folder,    path, line, found, name) {
            path = folder "/README.md"
            while ((found = (getline line < path)) > 0)
                while (match(line, /`[^`]*`/)) {
                    name = substr(line, RSTART + 1, RLENGTH - 2)
                    sub(/[.]h$/, "", name)
                    named[folder, name] = 1
                    line = substr(line, RSTART + RLENGTH - 1) # what ends one name may begin the next
                }
            close(path)
            return found == 0
        }
        {
            folder = module = $0
            sub(/[/][^/]*$/, "", folder)
            gsub(/^.*[/]|[.]h$/, "", module)
            if (!(folder in has_readme))
                has_readme[folder] = read_names(folder)
            while (!((folder, module) in named) && sub(/_[^_]*$/, "", module))
                ;
            if (!has_readme[folder])
                print $0 ": its folder has no README.md"
            else if (!((folder, module) in named))
                print $0 ": " folder "/README.md does not name it"
        }' >"$scratch/headers"
    while read -r line; do
        complain "$line"
    done <"$scratch/headers"
}

# Markdown files, without what builds write.
documents()
{
    find . \( -path ./build -o -path ./.git -o -path './debian/*/*' \) -prune -o -name '*.md' -print |
        sed 's|^\./||' | sort
}

# "file|DOCUMENT|TARGET" for each relative link of the documents, and "line|COMPLAINT" for each line of prose that is
# too long. Code blocks, tables and pictures may be wider.
read_documents()
{
    documents | xargs awk '
        FNR == 1 { is_code = 0 }
        /^```/ { is_code = !is_code; next }
        is_code || /^    / { next }
        length > 100 && !/^[|]/ && !/^!\[/ {
            print "line|" FILENAME ":" FNR ": more than 100 columns of prose"
        }
        {
            line = $0
            folder = FILENAME
            if (!sub(/[^\/]*$/, "", folder))
                folder = ""
            while (match(line, /\]\([^) ]*\)/)) {
                target = substr(line, RSTART + 2, RLENGTH - 3)
                line = substr(line, RSTART + RLENGTH)
                if (target !~ /^[a-z]*:/)
                    print "file|" FILENAME "|" (target ~ /^#/ ? FILENAME : folder) target
            }
        }'
}

# anchors FILE - what its headings are called in links.
anchors()
{
    sed -n '/^```/,/^```/d; s/^##* //p' "$1" | tr 'A-Z ' 'a-z-' | sed 's/[^-a-z0-9_]//g'
}

# Relative links lead to files and headings that exist, and prose has at most 100 columns.
check_documents()
{
    [ -n "$(documents)" ] || return 0
    read_documents >"$scratch/documents"
    sed -n 's/^line|//p' "$scratch/documents" >"$scratch/lines"
    while read -r line; do
        complain "$line"
    done <"$scratch/lines"
    grep '^file|' "$scratch/documents" | sort -u >"$scratch/links" || :
    while IFS='|' read -r _ document target; do
        path=${target%%#*}
        if [ ! -e "$path" ]; then
            complain "$document: no such file: $target"
        elif [ "$path" != "$target" ] && ! anchors "$path" | grep -qx -e "${target#*#}"; then
            complain "$document: no such heading: $target"
        fi
    done <"$scratch/links"
}

# Names of functions and paths in the documents that explain the code, so that these do not fall behind it.
check_names()
{
    for document in ARCHITECTURE.md docs/decisions.md; do
        [ -f "$document" ] || continue
        grep -o '`[A-Za-z0-9_./*]*`' "$document" | tr -d '`' | sort -u >"$scratch/quoted"
        grep '_' "$scratch/quoted" | grep -v '[./*]' >"$scratch/names" || :
        # shellcheck disable=SC2046 # a list of folders
        find $(for folder in proto builder client daemon tests; do [ ! -d $folder ] || echo $folder; done) \
            \( -name '*.[ch]' -o -name '*.glsl' \) -exec grep -ohwFf "$scratch/names" {} + |
            sort -u >"$scratch/found" || :
        for name in $(comm -23 "$scratch/names" "$scratch/found"); do
            complain "$document: nothing is called $name"
        done
        grep '^[a-z].*/.*[.][a-z]*$' "$scratch/quoted" | grep -v '[*]' >"$scratch/paths" || :
        while read -r path; do
            [ -e "$path" ] || complain "$document: no such file: $path"
        done <"$scratch/paths"
    done
}

# The picture of the folders has every folder, and no arrow that the table does not allow.
check_picture()
{
    picture=docs/pictures/architecture.dot
    [ -f "$picture" ] || return 0
    { folders | sed 's/^/folder /'; sed -n 's/^ *\("[^;]*\).*/picture \1/p' "$picture" | tr -d '"'; } | awk '
        $1 == "folder" {
            known[$2] = 1
            for (i = 3; i <= NF; i++)
                may[$2, $i] = 1
        }
        $1 == "picture" && $3 == "->" && !(($2, $4) in may) {
            print "an arrow that the table does not allow: " $2 " -> " $4
        }
        $1 == "picture" && $3 != "->" { drawn[$2] = 1 }
        END {
            for (folder in known)
                if (!(folder in drawn))
                    print folder " is missing"
        }' >"$scratch/picture"
    while read -r line; do
        complain "$picture: $line"
    done <"$scratch/picture"
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
    check_documents
    check_names
    check_picture
    [ ! -s "$scratch/complaints" ]
}

# must_fail WHAT FILE - the scratch tree with one more file has to be refused, for that file only; then the file goes.
must_fail()
{
    if (check_house "$tree") >"$tree/refused"; then
        echo "not found: $1"
        exit 1
    fi
    if grep -v "^$2:" "$tree/refused"; then
        echo "found beside it: $1"
        exit 1
    fi
    rm "$tree/$2" "$tree/refused"
}

# plant FILE INCLUDE - a file of the scratch tree with one include, as it is written.
plant()
{
    printf '%s\n#include %s\n' "$spdx" "$2" >"$tree/$1"
}

# must_refuse WHAT FILE INCLUDE
must_refuse()
{
    plant "$2" "$3"
    must_fail "$1" "$2"
}

# Of all pairs of folders those are refused that the table does not allow, and no others. The examples include what is
# beside them.
test_pairs()
{
    : >"$tree/expected"
    folders | grep -v '^client/examples' | while read -r from may; do
        folders | while read -r to rest; do
            planted=$from/to_$(echo "$to" | tr / _).c
            [ "$from" = "$to" ] || plant "$planted" "\"$to/low.h\""
            case " $from $may " in
            *" $to "*) ;;
            *) echo "$planted: includes $to/low.h, against the direction" >>"$tree/expected" ;;
            esac
        done
    done
    (check_house "$tree" || :) | sort >"$tree/refused"
    sort "$tree/expected" | diff - "$tree/refused" || { echo "the table of folders does not hold"; exit 1; }
    find "$tree" -name 'to_*.c' -exec rm {} +
}

# A picture with all folders and arrows is good; one folder less or one arrow more is not.
test_pictures()
{
    mkdir -p "$tree/docs/pictures"
    folders | awk '{
        print "\"" $1 "\" [label = \"x\"];"
        for (i = 2; i <= NF; i++)
            print "\"" $1 "\" -> \"" $i "\";"
    }' >"$tree/good"
    dot=docs/pictures/architecture.dot
    cp "$tree/good" "$tree/$dot"
    (check_house "$tree") || { echo "a good picture was refused"; exit 1; }
    grep -v '^"daemon/pool" \[' "$tree/good" >"$tree/$dot" && must_fail 'a folder that is not drawn' "$dot"
    { cat "$tree/good" && echo '"client" -> "daemon";'; } >"$tree/$dot"
    must_fail 'an arrow against the direction' "$dot"
}

self_test()
{
    tree=$(mktemp -d)
    trap 'rm -rf "$tree"' EXIT
    spdx='/* SPDX-License-Identifier: Apache-2.0 */'
    for folder in $(folders | sed 's/ .*//'); do
        mkdir -p "$tree/$folder"
        echo '`low` `a`' >"$tree/$folder/README.md"
        echo "$spdx" >"$tree/$folder/low.h"
    done
    mkdir -p "$tree/tests" "$tree/debian"
    plant builder/content_key.c '<openssl/evp.h>'
    (check_house "$tree") || { echo "a good tree was refused"; exit 1; }
    test_pairs
    plant builder/input/a.c '"builder/context.h"'
    echo "$spdx" >"$tree/builder/context.h" && echo '`low` `context`' >"$tree/builder/README.md"
    (check_house "$tree") || { echo "the one open header was refused"; exit 1; }
    rm "$tree/builder/input/a.c"
    must_refuse 'wire to the client' proto/wire/a.c '"client/low.h"'
    must_refuse 'an include without its path' proto/base/a.c '"low.h"'
    must_refuse "Embree's door" builder/a.c '<embree3/rtcore.h>'
    must_refuse "OpenSSL's door" builder/a.c '<openssl/evp.h>'
    must_refuse "Vulkan's door" builder/a.c '<vulkan/vulkan_core.h>'
    must_refuse "meshoptimizer's door" client/bvhctl/scene/a.c '<meshoptimizer.h>'
    must_refuse "libjpeg's door" client/bvhctl/scene/a.c '<jpeglib.h>'
    must_refuse "libpng's door" client/a.c '<png.h>'
    must_refuse "libuv's door" client/a.c '<uv.h>'
    must_refuse "systemd's door" client/a.c '<systemd/sd-daemon.h>'
    must_refuse "protobuf-c's door" proto/base/a.c '<protobuf-c/protobuf-c.h>'
    must_refuse 'the door of generated messages' daemon/session/a.c '"proto/wire/bvhd.pb-c.h"'
    mkdir "$tree/builder/new" && echo "$spdx" >"$tree/builder/new/a.c" && must_fail 'an unknown folder' builder/new/a.c
    echo 'int x;' >"$tree/tests/a.c" && must_fail 'no licence' tests/a.c
    { echo "$spdx" && yes 'int x;' | head -n 600; } >"$tree/proto/base/a.c" && must_fail 'a long file' proto/base/a.c
    echo "$spdx" >"$tree/proto/base/b.h" && must_fail 'a header that is not described' proto/base/b.h
    echo "$spdx" >"$tree/proto/base/low_part.h" && (check_house "$tree") && rm "$tree/proto/base/low_part.h"
    printf '%s\nint x; \n' "$spdx" >"$tree/proto/base/a.c" && must_fail 'a space at the end' proto/base/a.c
    for name in tests/a.c tests/a.sh tests/meson.build client/a.glsl debian/rules; do
        { echo "$spdx" && printf '%0121d\n' 0; } >"$tree/$name" && must_fail "a line of 121 columns: $name" "$name"
    done
    { echo '# SPDX-License-Identifier: Apache-2.0' && printf '#%0100d\n' 0; } >"$tree/tests/a.py"
    must_fail 'a line of 101 columns: tests/a.py' tests/a.py
    echo 'pass' >"$tree/tests/a.py" && must_fail 'no licence: tests/a.py' tests/a.py
    printf '%0100d x\n' 0 >"$tree/tests/a.md" && must_fail 'prose of 102 columns' tests/a.md
    { printf '| %0100d |\n\n    %0100d\n\n```\n%0100d\n```\n' 0 0 0; } >"$tree/tests/b.md"
    printf '# A Heading: `x`\n\n[here](#a-heading-x) [up](../builder/README.md) [other](https://example.org/)\n' \
        >>"$tree/tests/b.md"
    (check_house "$tree") || { echo "good documents were refused"; exit 1; }
    for link in no.md ../README.md '#a-heading' b.md#heading; do
        printf '[there](%s)\n' "$link" >"$tree/tests/a.md" && must_fail "a link to nowhere: $link" tests/a.md
    done
    echo 'See `low_part` in `proto/base/low.h`, `*_part.h` and `x`.' >"$tree/ARCHITECTURE.md"
    printf '%s\nint low_part;\n' "$spdx" >"$tree/proto/base/a.c"
    (check_house "$tree") || { echo "good names were refused"; exit 1; }
    rm "$tree/proto/base/a.c" && mv "$tree/ARCHITECTURE.md" "$tree/names"
    cp "$tree/names" "$tree/ARCHITECTURE.md" && must_fail 'a name that is gone' ARCHITECTURE.md
    echo 'See `proto/base/gone.h`.' >"$tree/ARCHITECTURE.md" && must_fail 'a path that is gone' ARCHITECTURE.md
    test_pictures
}

case ${1-} in
--self-test) self_test ;;
?*) check_house "$1" ;;
*) echo "usage: house_rules.sh ROOT | --self-test" >&2; exit 2 ;;
esac
