# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Completion for bash. bvhctl itself says what may follow (`bvhctl --complete WORD...`).
_bvhctl()
{
    local line endings='' word=${COMP_WORDS[COMP_CWORD]} path
    COMPREPLY=()
    while IFS= read -r line; do
        case $line in
        :files*) endings="${line#:files} " ;;
        *) COMPREPLY+=("${line%%$'\t'*}") ;;
        esac
    done < <("$1" --complete "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null)
    [ -n "$endings" ] || return 0
    compopt -o filenames 2>/dev/null
    [ "$word" != = ] || word=
    while IFS= read -r path; do
        [[ ${path##*/} != .* || ${word##*/} == .* ]] || continue
        # The endings are patterns such as *.as; without any, each file will do.
        if [ -d "$path" ] || [[ -z ${endings// /} || $endings == *" *.${path##*.} "* ]]; then
            COMPREPLY+=("$path")
        fi
    done < <(compgen -f -- "$word")
}
complete -o default -F _bvhctl bvhctl
