#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# generation.sh OUTPUT [OBJECT...] - writes the source with store_generation(): of a development build, which the
# objects of the builder identify, or of a release when there are none.
set -eu

output=$1
shift
name=release-1
if [ $# -gt 0 ]; then
    # The hashes of the files, without their paths, in an order that does not depend on the build.
    name=development-$(cat "$@" | sha256sum | cut -c 1-32)
fi
cat >"$output" <<END
/* Written by generation.sh. */
#include "builder/store/generation.h"

const char *store_generation(void)
{
    return "$name";
}
END
