# SPDX-License-Identifier: Apache-2.0
# Completion for fish. bvhctl itself says what may follow (`bvhctl --complete WORD...`).
function __bvhctl_complete
    set -l words (commandline -opc) (commandline -ct)
    for line in (command $words[1] --complete $words[2..-1] 2>/dev/null)
        if string match -q ':files*' -- $line
            set -l endings (string split -n ' ' -- (string replace -r '^:files ?' '' -- $line))
            if test (count $endings) -eq 0
                __fish_complete_path (commandline -ct)
            else
                # Directories are offered with the files of each ending.
                for ending in $endings
                    __fish_complete_suffix (string replace '*' '' -- $ending)
                end
            end
        else
            echo $line
        end
    end
end
complete -c bvhctl -f -a '(__bvhctl_complete)'
