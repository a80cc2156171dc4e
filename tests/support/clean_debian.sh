#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# clean_debian.sh SUITE FOLDER - runs ./demo and ./check of the committed tree in a fresh Debian SUITE (bookworm,
# trixie), which debootstrap makes below FOLDER and which is removed afterwards. It needs root, git, debootstrap and
# unshare.
set -eu
suite=$1
root=$2/clean-$suite
# shellcheck source=tests/support/fresh_debian.sh
. "$(dirname "$0")/fresh_debian.sh"

fresh_needs git
fresh_make git
git clone --quiet . "$root/root/bvhd"
inside 'cd /root/bvhd && ./demo && ./check'
