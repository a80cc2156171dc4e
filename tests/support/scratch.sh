# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=sh disable=SC2034 # the script that sources this uses the variables
# scratch.sh - the folder of a shell test, which sources it once its arguments are absolute paths. It makes and enters
# the folder $scratch, where no daemon is set. At the end of the test, which may be a signal, it stops the process
# $daemon, if any, and removes the folder.
scratch=$(mktemp -d)
daemon=
cleanup()
{
    [ -z "$daemon" ] || kill "$daemon" 2>/dev/null
    rm -rf "$scratch"
}
trap cleanup EXIT
trap 'exit 1' HUP INT TERM
cd "$scratch" || exit 1
unset BVHD_SOCKET NOTIFY_SOCKET
