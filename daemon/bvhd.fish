# SPDX-License-Identifier: Apache-2.0
# Completion for fish: the options that `bvhd --help` lists, and files.
function __bvhd_options
    command bvhd --help 2>/dev/null | string match -rg -- '^ +(?:-[a-z], )?(--[-a-z]+)'
end
complete -c bvhd -n 'string match -q -- "-*" (commandline -ct)' -f -a '(__bvhd_options)'
