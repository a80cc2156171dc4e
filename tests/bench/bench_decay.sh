#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# bench_decay.sh BENCH_DECAY - tests small runs in every quality: that the table, the figures of the rule and the file
# have all rows, that an update at rest has not decayed, and that wrong arguments are refused.
set -eu

bench=$1
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

fail()
{
    echo "$*" >&2
    exit 1
}

# counts WANTED PATTERN FILE - checks how many lines of FILE match the extended regular expression.
counts()
{
    got=$(grep -Ec "$2" "$3" || true)
    [ "$got" -eq "$1" ] || fail "$3: $got lines with $2, rather than $1"
}

# refuses STATUS ARGUMENT... - checks the status of a run that cannot be made.
refuses()
{
    wanted=$1
    shift
    status=0
    "$bench" "$@" >/dev/null 2>&1 || status=$?
    [ "$status" -eq "$wanted" ] || fail "$*: status $status, rather than $wanted"
}

for quality in fast balanced high; do
    "$bench" --quality $quality --size 200 --picture 8 --runs 1 cloth scan >"$scratch/$quality"
    counts 1 "^1 threads, $quality, portable, " "$scratch/$quality"
    counts 14 '^cloth +[0-9]+ \|( +[0-9.]+){4} \|( +[-0-9.a-z]+){3} \|( +[-0-9.a-z]+){3} \|( +[0-9.]+){2} \| ' \
        "$scratch/$quality"
    counts 2 ' 0 \|   1\.000 ' "$scratch/$quality"
    counts 2 '^(cloth|scan) +a build takes as long as [0-9.]+ diffuse rays for each primitive ' "$scratch/$quality"
    counts 6 '^with [0-9.]+ rays a primitive the rule loses [0-9.]+ % on average, and ' "$scratch/$quality"
done

# Built after a turn, an update in that pose has not decayed, and others are worse or better.
mkdir "$scratch/charts"
"$bench" --size 200 --picture 8 --runs 1 --from 90 -o "$scratch/charts" cloth >"$scratch/turned"
counts 15 '^[a-z_]+(,[^,]+){14}$' "$scratch/charts/decay.csv"
counts 1 '^cloth,[0-9]+,1,' "$scratch/charts/decay.csv"
counts 1 '^cloth,90,1,' "$scratch/charts/decay.csv"
! command -v gnuplot >/dev/null || counts 1 '</svg>' "$scratch/charts/decay.svg"

refuses 2
refuses 2 --quality balanced
refuses 2 --quality sweep cloth
refuses 2 --quality none cloth
refuses 2 --picture 9 cloth
refuses 2 --runs 0 cloth
refuses 2 a b c d e f g h i
refuses 1 "$scratch/absent.ply"
refuses 1 --size 200 --picture 8 --runs 1 -o "$scratch/absent" cloth
