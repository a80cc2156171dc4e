#compdef bvhd
# SPDX-License-Identifier: Apache-2.0
# Completion for zsh: the options that `bvhd --help` lists, and files.
_gnu_generic
