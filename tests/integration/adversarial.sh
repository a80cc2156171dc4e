#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# adversarial.sh MAKE_SCENE BVHCTL SCENE... - generates each scene, builds it in each quality, and checks it against
# brute force. The status is 1 if a build fails or an answer is wrong. $SIZE is the number of triangles (4000 by
# default), $RAYS that of rays (1000),
# $BUILDER the builder (own).
set -eu
make_scene=$1
bvhctl=$2
shift 2
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
status=0
for name; do
    "$make_scene" "$name" --size "${SIZE:-4000}" -o "$scratch/$name.ply" >/dev/null
    for quality in fast balanced high; do
        out=$scratch/$name-$quality
        if ! "$bvhctl" --local build "$scratch/$name.ply" -o "$out" --quality "$quality" \
            --builder "${BUILDER:-own}" --no-cache >"$scratch/log" 2>&1; then
            echo "$name, $quality: the build failed"
        elif ! "$bvhctl" --local check "$out" "$scratch/$name.ply" --rays "${RAYS:-1000}" >"$scratch/log" 2>&1; then
            echo "$name, $quality: the check failed"
        else
            continue
        fi
        cat "$scratch/log"
        status=1
    done
done
exit $status
