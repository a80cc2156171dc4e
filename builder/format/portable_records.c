/* SPDX-License-Identifier: Apache-2.0 */
typedef int portable_records_placeholder;
