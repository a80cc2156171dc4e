#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# manuals.sh SOURCE BVHD BVHCTL - tests that the manual pages name the same options, commands and version as the
# programs' help, all counters and all events of the log, and have no mistake that groff reports, if it is installed;
# and that shells complete what bvhctl offers. It prints each expectation that does not hold, and its status is 1 if
# there is one.
set -u
export LC_ALL=C
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
source=$(realpath "$1")
bvhd=$(realpath "$2")
bvhctl=$(realpath "$3")
# shellcheck source=tests/support/scratch.sh
. "$(dirname "$0")/../support/scratch.sh"

# options FILE... - prints the long options that the files name, one a line.
options()
{
    sed 's/\\-/-/g' "$@" | grep -oE -- '(^|[^-a-z])--[a-z][-a-z]*' | sed 's/^[^-]//' | sort -u
}

# page FILE PROGRAM HELP - checks one manual page against its program.
page()
{
    "$2" --version >version
    expect "$1: the version of $(cat version)" \
        grep -q "\"bvhd $(sed 's/.* \([0-9]*\.[0-9]*\)\..*/\1/' version)\"" "$source/$1"
    options "$source/$1" >written
    options "$3" >offered
    expect "$1: there are options" [ "$(wc -l <offered)" -gt 5 ]
    expect "$1: the options of the help (>) and no others (<)" diff written offered
    if command -v groff >/dev/null; then
        groff -man -Tascii -ww "$source/$1" >text 2>said
        expect "$1: groff has nothing to say: $(head -n 5 said)" [ ! -s said ]
        expect "$1: it has text" grep -q 'EXIT STATUS\|E.EX.XI.IT' text
    fi
}

# terms FILE - prints the terms that a manual page defines in its first column, one a line.
terms()
{
    sed -n 's/^\.BR\{0,1\} \([a-z]*_[a-z_", ]*\|[a-z][a-z_", ]*\)$/\1/p' "$1" | tr -d '",' | tr -s ' ' '\n' | sort -u
}

# all_terms WHAT FILE - expects that each word of standard input is a term of the manual page.
all_terms()
{
    terms "$source/$2" >known
    sort -u >wanted
    expect "$1: there are some" [ "$(wc -l <wanted)" -gt 10 ]
    expect "$2: all $1, but not: $(comm -23 wanted known | tr '\n' ' ')" [ -z "$(comm -23 wanted known)" ]
}

"$bvhd" --help >bvhd.help
page daemon/bvhd.8 "$bvhd" bvhd.help

"$bvhctl" --help >bvhctl.help
commands=$(sed -n '/^Commands:/,/^$/s/^  \([a-z][a-z]*\) .*/\1/p' bvhctl.help)
expect 'there are commands' [ "$(echo "$commands" | wc -w)" -gt 5 ]
for command in $commands; do
    "$bvhctl" "$command" --help >>bvhctl.help
    expect "bvhctl.1: $command" grep -qE "^\.BI? $command( |\$)" "$source/client/bvhctl/bvhctl.1"
done
page client/bvhctl/bvhctl.1 "$bvhctl" bvhctl.help

find "$source/daemon" -name "*.c" -exec cat {} + | grep -o 'log_event([^"]*"[a-z_]*"' |
    sed 's/.*"\(.*\)"/\1/' >events.list
all_terms 'events of the log' daemon/bvhd.8 <events.list
sed -n 's/^    X(\([a-z_]*\)).*/\1/p' "$source/daemon/service/counters.h" >counters.list
all_terms counters client/bvhctl/bvhctl.1 <counters.list

# completes WORDS WHAT - expects that bash completes the last of the words to that.
completes()
{
    # shellcheck disable=SC2016 # the other shell's
    offered=$(bash -c '. "$1"; program=$2; read -ra COMP_WORDS <<<"$3"; [ "${3% }" = "$3" ] || COMP_WORDS+=("")
        COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
        _bvhctl "$program"; echo "${COMPREPLY[*]}"' bash "$source/client/bvhctl/bvhctl.bash" "$bvhctl" "$1")
    expect "'$1' is completed by '$2': $offered" [ "$offered" = "$2" ]
}

if command -v bash >/dev/null; then
    completes 'bvhctl bu' build
    completes 'bvhctl --socket s p' 'ping probe'
    completes 'bvhctl --socket = s p' 'ping probe'
    completes 'bvhctl ' "$(echo "$commands" | tr '\n' ' ' | sed 's/ $//')"
    completes 'bvhctl --v' '--verbose --version'
    completes 'bvhctl check --s' '--seed --scene --socket'
    completes 'bvhctl --json check d s --fl' --flip-order
    completes 'bvhctl build --ou' --output
    completes 'bvhctl build sc' ''
    completes 'bvhctl --socket p' ''
    completes 'bvhctl build --target ' 'portable lavapipe'
    completes 'bvhctl build --target = l' lavapipe
    completes 'bvhctl build --flags low-memory,allow-d' low-memory,allow-data-access
    completes 'bvhctl trace d --up ' 'auto x y z'
    mkdir built
    touch scene.ply sums.txt out.bvhd picture.png .hidden.ply
    completes 'bvhctl build s' scene.ply
    completes 'bvhctl build .h' .hidden.ply
    completes 'bvhctl check o' out.bvhd
    completes 'bvhctl check b' built
    completes 'bvhctl trace out -o p' picture.png
fi
if command -v bash >/dev/null; then
    offered=$(bash -c '. "$1"; COMP_WORDS=(bvhd --con); COMP_CWORD=1; _bvhd "$2"; echo "${COMPREPLY[*]}"' \
        bash "$source/daemon/bvhd.bash" "$bvhd")
    expect "the options of bvhd are completed: $offered" [ "$offered" = --config ]
fi
if command -v zsh >/dev/null; then
    expect 'zsh reads its completion of bvhd' zsh -n "$source/daemon/bvhd.zsh"
    expect 'zsh reads its completion' zsh -n "$source/client/bvhctl/bvhctl.zsh"
fi
if command -v fish >/dev/null; then
    mkdir bin
    ln -s "$bvhctl" bin/bvhctl
    offered=$(HOME=$scratch PATH=$scratch/bin:$PATH fish --no-config -c "source $source/client/bvhctl/bvhctl.fish
        complete -C 'bvhctl build --target l'" | cut -f 1)
    expect "fish completes a value: $offered" [ "$offered" = lavapipe ]
fi

echo "$checks expectations, $failures do not hold"
[ $failures -eq 0 ]
