/* SPDX-License-Identifier: Apache-2.0 */
/* unit.h - cmocka, with the headers that it requires before it. Every unit test starts with this. */
#ifndef BVHD_UNIT_H
#define BVHD_UNIT_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#endif
