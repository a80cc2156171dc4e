#compdef bvhctl
# SPDX-License-Identifier: Apache-2.0
# Completion for zsh. bvhctl itself says what may follow (`bvhctl --complete WORD...`).
_bvhctl()
{
    local line patterns
    local -a candidates
    while IFS= read -r line; do
        if [[ $line == :files* ]]; then
            patterns=${${line#:files }:-*}
        else
            candidates+=("${${line%%$'\t'*}//:/\\:}:${line#*$'\t'}")
        fi
    done < <("${(Q)words[1]}" --complete "${(@Q)words[2,CURRENT]}" 2>/dev/null)
    (( $#candidates )) && _describe bvhctl candidates
    [[ -n $patterns ]] && _files -g $patterns
}
_bvhctl "$@"
