#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# dance_sheet.sh BUILD - makes docs/pictures/dance.png: nine frames of a generated animation, whose structures are built
# once and then updated, traced by bvhctl. BUILD is a build folder with bvhctl, bvhd and make_scene.
set -eu

build=$1
work=$(mktemp -d)
"$build/daemon/bvhd" --socket "$work/s" --no-cache 2>"$work/log" &
daemon=$!
trap 'kill "$daemon"; rm -rf "$work"' EXIT
bvhctl=$build/client/bvhctl/bvhctl
export BVHD_SOCKET="$work/s"

"$bvhctl" --connect-timeout 30 ping >"$work/log"
"$build/tests/support/make_scene" dance -o "$work/dance.glb" >"$work/log"
"$bvhctl" build -q "$work/dance.glb" --at 0 --flags allow-update -o "$work/dance"
"$bvhctl" update -q "$work/dance" "$work/dance.glb" --frames 0:4:0.5 -o "$work/seq"
frame=0
for moment in 0000 0500 1000 1500 2000 2500 3000 3500 4000; do
    "$bvhctl" trace -q "$work/seq/000$frame" "$work/dance.glb" --device cpu --size 288x192 --eye 7,4.5,9 \
        --look-at 0,1.7,0 -o "$work/$moment ms.png"
    frame=$((frame + 1))
done
"$build/tests/support/contact_sheet" 3 docs/pictures/dance.png "$work"/*' ms.png'
