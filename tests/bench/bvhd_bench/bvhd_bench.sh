#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# bvhd_bench.sh BVHD-BENCH - tests small runs of all kinds: that the reports have their structure, that all cells of
# our own are clean, and that the pictures are valid files.
set -eu

bench=$1
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

fail()
{
    echo "$*" >&2
    exit 1
}

# has FILE PATTERN - checks that a line of FILE matches the extended regular expression.
has()
{
    grep -Eq "$2" "$1" || fail "$1: no $2"
}

# starts_as FILE BYTES - checks that FILE starts with these eight bytes, in hexadecimal.
starts_as()
{
    [ "$(head -c 8 "$1" | od -An -tx1 | tr -d ' \n')" = "$2" ] || fail "$1: has the wrong first bytes"
}

# check_json FILE - checks that there is one object, that brackets are in pairs, and that no number is NaN or infinite.
check_json()
{
    tr -d '\n' <"$1" | grep -Eq '^\{.*\}$' || fail "$1: not one object"
    [ "$(tr -cd '{[' <"$1" | wc -c)" -eq "$(tr -cd '}]' <"$1" | wc -c)" ] || fail "$1: brackets without a partner"
    ! grep -Eiq '(: |^ *)-?(nan|inf)' "$1" || fail "$1: a number is NaN or infinite"
    has "$1" '"schema": ?1,'
}

check_pictures()
{
    if ! command -v gnuplot >/dev/null; then
        echo "there is no gnuplot: the charts are not checked"
        return 0
    fi
    for name; do
        starts_as "$scratch/$name.png" 89504e470d0a1a0a
        has "$scratch/$name.svg" '<svg '
        tail -n 2 "$scratch/$name.svg" | grep -q '</svg>' || fail "$name.svg: has no end"
    done
}

status=0
"$bench" 2>/dev/null || status=$?
[ "$status" -eq 2 ] || fail "no arguments: $status"
status=0
"$bench" --stability nan-inf -o "$scratch/x" --rays many 2>/dev/null || status=$?
[ "$status" -eq 2 ] || fail "an invalid number: $status"
status=0
"$bench" "$scratch/absent.ply" -o "$scratch/x" 2>/dev/null || status=$?
[ "$status" -eq 1 ] || fail "a missing scene: $status"

# With few methods the charts have few points, or none.
for methods in high embree/bvh-medium-2; do
    "$bench" slivers -o "$scratch" --runs 1 --patience 0 --size 300 --picture 8 --rays 10 --methods $methods >/dev/null
    check_pictures scenes
    rm -f "$scratch"/scenes.* "$scratch/report.json"
done

"$bench" stadium-like slivers -o "$scratch" --runs 3 --patience 0 --size 3000 --picture 32 --rays 100 >/dev/null
check_json "$scratch/report.json"
for method in fast balanced high auto-0.1 auto-1 auto-10 auto-100 balanced/fast-triangles balanced/lavapipe \
    fast/embree balanced/embree high/embree sweep embree/bvh-medium-2 embree/scene-medium-robust; do
    has "$scratch/report.json" "\"method\": ?\"$method\""
done
for key in settings floors summary scenes stages_ms mprim_s median mad sah overlap inner_steps_per_diffuse_ray \
    refs_per_triangle nodes vertices peak_resident_bytes facts crossings thickness unevenness auto \
    rays_per_primitive chosen quality primary diffuse shadow wrong_miss wrong_hit wrong_primitive t_rel_err_max; do
    has "$scratch/report.json" "\"$key\": ?"
done
check_pictures speed work bytes error scenes

"$bench" --calibrate rooms clutter@2 hair@3@2000 --runs 1 --size 3000 --picture 32 >"$scratch/constants" 2>/dev/null
row='^    \[QUALITY_(FAST|BALANCED|HIGH)\] = \{\{(-?[0-9.]+(, )?){6}\}, \{(-?[0-9.]+(, )?){6}\}\},$'
[ "$(grep -Ec "$row" "$scratch/constants")" -eq 3 ] || fail 'calibration: no constants'
[ "$(grep -c '^hair@3@2000 .* 20[0-9][0-9] ' "$scratch/constants")" -eq 1 ] ||
    fail 'calibration: no row of a scene'
status=0
"$bench" rooms --size 3000 2>/dev/null || status=$?
[ "$status" -eq 2 ] || fail "nowhere to write: $status"

"$bench" --stability nan-inf huge denormal offset expchain -o "$scratch" --size 300 --rays 100 ||
    fail "cells of our own are not clean"
check_json "$scratch/stability.json"
has "$scratch/stability.json" '"own_failures": ?0,'
has "$scratch/stability.md" '^\| expchain \|'
check_pictures stability
