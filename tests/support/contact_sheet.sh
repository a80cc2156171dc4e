#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# contact_sheet.sh BUILD [SIZE [COLUMNS]] - makes docs/pictures/contact_sheet.png: generates the scenes of the gallery,
# has bvhctl build and trace each, and puts the pictures into one. BUILD is a build folder with bvhctl and make_scene.
set -eu

build=$1
size=${2-288x192}
columns=${3-8}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

pictures=
for scene in $("$build/tests/support/make_scene" --gallery); do
    name=${scene#gallery-}
    "$build/tests/support/make_scene" "$scene" -o "$work/$name.gltf" >"$work/log"
    "$build/client/bvhctl/bvhctl" build --local -q "$work/$name.gltf" -o "$work/$name" >"$work/log"
    "$build/client/bvhctl/bvhctl" trace -q "$work/$name" --device cpu --size "$size" -o "$work/$name.png" >"$work/log"
    pictures="$pictures $work/$name.png"
done
# shellcheck disable=SC2086 # a list of words
"$build/tests/support/contact_sheet" "$columns" docs/pictures/contact_sheet.png $pictures
