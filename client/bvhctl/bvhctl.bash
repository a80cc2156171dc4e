# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Completion for bash: commands and options, as `bvhctl --help` lists them, and files.
_bvhctl()
{
    local word=${COMP_WORDS[COMP_CWORD]} command='' i
    COMPREPLY=()
    for ((i = 1; i < COMP_CWORD; i++)); do
        case ${COMP_WORDS[i]} in
        --socket | --connect-timeout)
            ((i++))
            [ "${COMP_WORDS[i]}" != = ] || ((i++))
            ;;
        -*) ;;
        *)
            command=${COMP_WORDS[i]}
            break
            ;;
        esac
    done
    if [[ $word == -* ]]; then
        mapfile -t COMPREPLY < <(compgen -W "$("$1" ${command:+"$command"} --help 2>/dev/null | sed -n 's/^  [-a-z, ]\{4\}\(--[-a-z]*\).*/\1/p')" -- "$word")
    elif [[ -z $command && ${COMP_WORDS[COMP_CWORD - 1]} != --* ]]; then
        mapfile -t COMPREPLY < <(compgen -W "$("$1" --help 2>/dev/null | sed -n '/^Commands:/,/^$/s/^  \([a-z][a-z]*\) .*/\1/p')" -- "$word")
    fi
}
complete -o default -F _bvhctl bvhctl
