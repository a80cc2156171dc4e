/* SPDX-License-Identifier: Apache-2.0 */
/* test_schema.c - tests that the schema of control messages stays flat, and that its fields never change. */
#include "tests/support/unit.h"

#include <stdbool.h>

#include "proto/wire/bvhd.pb-c.h"

static const ProtobufCMessageDescriptor *const messages[] = {
    &bvhd__hello__descriptor,       &bvhd__welcome__descriptor,     &bvhd__pool__descriptor,
    &bvhd__build__descriptor,       &bvhd__get__descriptor,         &bvhd__items__descriptor,
    &bvhd__progress__descriptor,    &bvhd__error__descriptor,       &bvhd__result__descriptor,
    &bvhd__busy__descriptor,        &bvhd__counter__descriptor,     &bvhd__counters__descriptor,
    &bvhd__clients__descriptor,     &bvhd__client_list__descriptor, &bvhd__cache__descriptor,
    &bvhd__cache_state__descriptor, &bvhd__released__descriptor,
};
enum { MESSAGES = sizeof messages / sizeof messages[0], DEEPEST = 2, LINE = 100 };

/*
 * Field numbers and types are ABI. A new field adds a line; a changed or missing line is a defect, unless its field is
 * listed in `reserved`.
 */
static const char *const fields[] = {
    "Hello.version_min 1 uint32",
    "Hello.version_max 2 uint32",
    "Hello.software 3 string",
    "Hello.progress_ms 4 uint32",
    "Hello.releases 5 uint32",
    "Welcome.version 1 uint32",
    "Welcome.software 2 string",
    "Welcome.credits 3 uint32",
    "Welcome.max_items 4 uint32",
    "Welcome.max_control 5 uint32",
    "Welcome.max_inline 6 uint32",
    "Welcome.max_pool 7 uint64",
    "Welcome.max_payload 8 uint64",
    "Welcome.max_held 9 uint64",
    "Welcome.builders 10 uint32",
    "Welcome.updates 11 uint32",
    "Welcome.micromaps 12 uint32",
    "Pool.size 1 uint64",
    "Build.priority 1 sint32",
    "Build.memfd_sizes 2 repeated fixed64",
    "Build.item_size 3 uint32",
    "Build.items 4 bytes",
    "Build.deadline_ms 5 uint32",
    "Get.keys 1 bytes",
    "Items.items 1 repeated fixed32",
    "Progress.items 1 repeated fixed32",
    "Progress.thousandths 2 repeated fixed32",
    "Error.status 1 uint32",
    "Error.rule 2 uint32",
    "Error.where 3 string",
    "Error.text 4 string",
    "Result.item 1 uint32",
    "Result.status 2 uint32",
    "Result.rule 3 uint32",
    "Result.where 4 string",
    "Result.text 5 string",
    "Result.key 6 bytes",
    "Result.size 7 uint64",
    "Result.origin 8 uint32",
    "Result.queued_ms 9 fixed64",
    "Result.prepare_ms 10 fixed64",
    "Result.build_ms 11 fixed64",
    "Result.primitives 16 uint64",
    "Result.triangles 17 uint64",
    "Result.instances 18 uint64",
    "Result.inactive 19 uint64",
    "Result.degenerate 20 uint64",
    "Result.skipped 21 uint64",
    "Result.refs 22 uint64",
    "Result.peak_bytes 23 uint64",
    "Result.depth 24 uint32",
    "Result.target 25 uint32",
    "Result.sah 26 fixed64",
    "Result.first_build_ms 27 fixed64",
    "Result.method 28 string",
    "Result.bounds 29 repeated float",
    "Result.quality 30 uint32",
    "Result.slabs 31 repeated float",
    "Result.decay 32 fixed64",
    "Result.refits 33 uint32",
    "Busy.retry_ms 1 uint32",
    "Counter.name 1 string",
    "Counter.value 2 uint64",
    "Counters.counters 1 repeated Counter",
    "Counters.version 2 string",
    "Released.bytes 1 uint64",
    "Clients.all 1 uint32",
    "ClientList.client_size 1 uint32",
    "ClientList.clients 2 bytes",
    "ClientList.total 3 uint32",
    "ClientList.hidden 4 uint32",
    "Cache.action 1 uint32",
    "Cache.bytes 2 uint64",
    "CacheState.directory 1 string",
    "CacheState.counted 2 bool",
    "CacheState.entries 3 uint64",
    "CacheState.bytes 4 uint64",
    "CacheState.budget 5 uint64",
    "CacheState.memory_entries 6 uint64",
    "CacheState.memory_bytes 7 uint64",
    "CacheState.memory_budget 8 uint64",
};
enum { FIELDS = sizeof fields / sizeof fields[0] };

/*
 * Returns the number of levels of messages from this one down, and fails if there is no end. Every message below must
 * be in the list above.
 */
static int depth_of(const ProtobufCMessageDescriptor *message, int above)
{
    int deepest = 0, listed = 0;
    for (int i = 0; i < MESSAGES; i++)
        listed += messages[i] == message;
    assert_int_equal(listed, 1);
    if (above > MESSAGES)
        fail_msg("%s contains itself", message->name);
    for (unsigned i = 0; i < message->n_fields; i++) {
        const ProtobufCFieldDescriptor *field = &message->fields[i];
        if (field->type == PROTOBUF_C_TYPE_MESSAGE) {
            int depth = depth_of(field->descriptor, above + 1);
            deepest = depth > deepest ? depth : deepest;
        }
    }
    return deepest + 1;
}

static void no_message_contains_itself(void **state)
{
    (void)state;
    for (int i = 0; i < MESSAGES; i++)
        assert_true(depth_of(messages[i], 0) <= DEEPEST);
}

/*
 * protobuf-c merges a single submessage that is given twice, by code that nothing here should need; it does not merge
 * repeated ones.
 */
static void submessages_are_repeated_alone(void **state)
{
    (void)state;
    for (int i = 0; i < MESSAGES; i++)
        for (unsigned k = 0; k < messages[i]->n_fields; k++)
            if (messages[i]->fields[k].type == PROTOBUF_C_TYPE_MESSAGE)
                assert_int_equal(messages[i]->fields[k].label, PROTOBUF_C_LABEL_REPEATED);
}

/*
 * A list is either one field of bytes, or numbers of a fixed width; otherwise two bytes would cost much memory.
 * Counters are an exception, because they are few.
 */
static void lists_are_no_longer_than_their_bytes(void **state)
{
    (void)state;
    for (int i = 0; i < MESSAGES; i++)
        for (unsigned k = 0; k < messages[i]->n_fields; k++) {
            const ProtobufCFieldDescriptor *field = &messages[i]->fields[k];
            if (field->label == PROTOBUF_C_LABEL_REPEATED && messages[i] != &bvhd__counters__descriptor)
                assert_true(field->type == PROTOBUF_C_TYPE_FIXED32 || field->type == PROTOBUF_C_TYPE_FIXED64 ||
                            field->type == PROTOBUF_C_TYPE_FLOAT);
        }
}

static const char *type_name(const ProtobufCFieldDescriptor *field)
{
    switch (field->type) {
    case PROTOBUF_C_TYPE_UINT32:
        return "uint32";
    case PROTOBUF_C_TYPE_SINT32:
        return "sint32";
    case PROTOBUF_C_TYPE_FIXED32:
        return "fixed32";
    case PROTOBUF_C_TYPE_UINT64:
        return "uint64";
    case PROTOBUF_C_TYPE_FIXED64:
        return "fixed64";
    case PROTOBUF_C_TYPE_BOOL:
        return "bool";
    case PROTOBUF_C_TYPE_FLOAT:
        return "float";
    case PROTOBUF_C_TYPE_STRING:
        return "string";
    case PROTOBUF_C_TYPE_BYTES:
        return "bytes";
    case PROTOBUF_C_TYPE_MESSAGE:
        return ((const ProtobufCMessageDescriptor *)field->descriptor)->short_name;
    default:
        return "a type that is not in use";
    }
}

static bool is_listed(const char *line)
{
    for (int i = 0; i < FIELDS; i++)
        if (strcmp(fields[i], line) == 0)
            return true;
    return false;
}

static void fields_stay_as_they_are(void **state)
{
    (void)state;
    int count = 0;
    for (int i = 0; i < MESSAGES; i++)
        for (unsigned k = 0; k < messages[i]->n_fields; k++, count++) {
            const ProtobufCFieldDescriptor *field = &messages[i]->fields[k];
            char line[LINE];
            snprintf(line, sizeof line, "%s.%s %u %s%s", messages[i]->short_name, field->name, field->id,
                     field->label == PROTOBUF_C_LABEL_REPEATED ? "repeated " : "", type_name(field));
            if (!is_listed(line))
                fail_msg("not in the list: %s", line);
        }
    assert_int_equal(count, FIELDS);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_message_contains_itself),
        cmocka_unit_test(submessages_are_repeated_alone),
        cmocka_unit_test(lists_are_no_longer_than_their_bytes),
        cmocka_unit_test(fields_stay_as_they_are),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
