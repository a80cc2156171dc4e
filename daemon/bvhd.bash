# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Completion for bash: the options that `bvhd --help` lists, and files.
_bvhd()
{
    local word=${COMP_WORDS[COMP_CWORD]}
    COMPREPLY=()
    [[ $word == -* ]] || return 0
    mapfile -t COMPREPLY < <(compgen -W "$("$1" --help 2>/dev/null | grep -oE -- '^ +(-[a-z], )?--[-a-z]+' | grep -oE -- '--.*')" -- "$word")
}
complete -o default -F _bvhd bvhd
