#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# setup_sources.sh ROOT - tests that setup_vulkan.sh derives sources of backports from samples of apt's sources in a
# scratch folder. ROOT is the repository.
set -eu
cd "$1"
. tests/support/setup_vulkan.sh
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
failed=0

# expect NAME WANTED - compares the source that is derived from $scratch/etc with WANTED: its lines, or "nothing".
expect()
{
    file=$(setup_backports_source "$scratch" bookworm) || file=
    got=nothing
    [ -z "$file" ] || got=$(cat "$file")
    if [ "$got" != "$2" ]; then
        printf 'not ok: %s\n  wanted: %s\n  got:    %s\n' "$1" "$2" "$got"
        failed=1
    fi
    case $file in
    '' | *.list | *.sources) ;;
    *) echo "not ok: $1: $file"; failed=1 ;;
    esac
    rm -rf "${scratch:?}/etc"
    mkdir -p "$scratch/etc/apt/sources.list.d"
}

list()
{
    cat >"$scratch/etc/apt/$1"
}

mkdir -p "$scratch/etc/apt/sources.list.d"
expect 'no sources' nothing

list sources.list <<'END'
# deb http://archive.example/debian bookworm main
deb-src http://archive.example/debian bookworm main
deb http://archive.example/debian-security bookworm-security main
deb http://archive.example/debian bookworm-updates main
deb http://archive.example/debian bookworm main contrib # the archive
END
expect 'one-line' 'deb http://archive.example/debian bookworm-backports main'

list sources.list.d/debian.list <<'END'
deb [ arch=amd64 signed-by=/usr/share/keyrings/a.gpg ] https://mirror.example/debian/ bookworm contrib main
END
expect 'options' \
    'deb [ arch=amd64 signed-by=/usr/share/keyrings/a.gpg ] https://mirror.example/debian/ bookworm-backports main'

list sources.list <<'END'
deb [trusted=yes] mirror+file:/etc/apt/mirrors/debian.list oldstable main
END
expect 'a mirror list, and the name of the release' \
    'deb [trusted=yes] mirror+file:/etc/apt/mirrors/debian.list oldstable-backports main'

list sources.list <<'END'
deb cdrom:[Debian GNU/Linux 12]/ bookworm main
deb https://packages.example/deb bookworm main
deb http://archive.example/debian bookworm main
END
expect 'others before the archive' 'deb http://archive.example/debian bookworm-backports main'

list sources.list <<'END'
deb https://proxy.example/apt bookworm main
END
expect 'an address that tells nothing' 'deb https://proxy.example/apt bookworm-backports main'

list sources.list <<'END'
deb http://archive.example/debian trixie main
deb http://archive.example/debian bookworm contrib
END
expect 'another release, another component' nothing

list sources.list.d/debian.sources <<'END'
# comment
Types: deb deb-src
# another
URIs: http://archive.example/debian
Suites: bookworm bookworm-updates
Components: main contrib
Signed-By: /usr/share/keyrings/debian-archive-keyring.gpg

Types: deb
URIs: http://archive.example/debian-security
Suites: bookworm-security
Components: main
Signed-By: /usr/share/keyrings/debian-archive-keyring.gpg
END
expect 'deb822' 'Types: deb
URIs: http://archive.example/debian
Suites: bookworm-backports
Components: main
Signed-By: /usr/share/keyrings/debian-archive-keyring.gpg'

list sources.list.d/a.sources <<'END'
Types: deb
URIs: https://packages.example/deb
Suites: bookworm
Components: main
Signed-By: /a.gpg
END
list sources.list.d/b.sources <<'END'
types: deb
uris:
 https://one.example/debian
 https://two.example/debian/
suites: bookworm
components: main
Check-Valid-Until: no
Signed-By:
 -----BEGIN PGP PUBLIC KEY BLOCK-----
 .
 abc
 -----END PGP PUBLIC KEY BLOCK-----
END
expect 'several lines, keys within' 'Types: deb
URIs: https://one.example/debian https://two.example/debian/
Suites: bookworm-backports
Components: main
Check-Valid-Until: no
Signed-By:
 -----BEGIN PGP PUBLIC KEY BLOCK-----
 .
 abc
 -----END PGP PUBLIC KEY BLOCK-----'

list sources.list.d/debian.sources <<'END'
Types: deb
URIs: http://archive.example/debian
Suites: bookworm
Components: main
Enabled: no
END
expect 'switched off' nothing

list sources.list.d/debian.sources <<'END'
Types: deb-src
URIs: http://archive.example/debian
Suites: bookworm
Components: main
END
expect 'sources alone' nothing

[ "$failed" -eq 0 ] && echo "all derived as they should be"
