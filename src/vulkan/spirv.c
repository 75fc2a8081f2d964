/* SPDX-License-Identifier: MIT
 *
 * spirv.c - see spirv.h. One pass over the instructions (SPIR-V 1.6, 2.3 and 3): decorations come before types, types before their uses, so
 * that sizes are known when they are needed.
 */
#include "vulkan/spirv.h"

#include <string.h>

enum {
    HEADER = 5,            /* words */
    MAX_IDS = 1 << 18,     /* a module of the largest size has fewer */
    MAX_MEMBERS = 1 << 12, /* decorations of members of structs */
    MAX_STRUCTS = 1 << 10,
    MAX_BLOCK_MEMBERS = 64, /* members of a buffer's block */
    MAX_SHARED = 16 << 10,  /* bytes of shared memory of a workgroup: guaranteed on every device */
    MAX_PRIVATE = 32 << 10, /* bytes of an invocation's own variables */
    NO_BINDING = 0xffffffff
};

enum opcode {
    EXTENSION = 10,
    EXT_INST_IMPORT = 11,
    MEMORY_MODEL = 14,
    ENTRY_POINT = 15,
    EXECUTION_MODE = 16,
    CAPABILITY = 17,
    TYPE_BOOL = 20,
    TYPE_INT = 21,
    TYPE_FLOAT = 22,
    TYPE_VECTOR = 23,
    TYPE_MATRIX = 24,
    TYPE_IMAGE = 25,
    TYPE_ARRAY = 28,
    TYPE_RUNTIME_ARRAY = 29,
    TYPE_STRUCT = 30,
    TYPE_POINTER = 32,
    CONSTANT = 43,
    CONSTANT_COMPOSITE = 44,
    FUNCTION = 54,
    FUNCTION_END = 56,
    VARIABLE = 59,
    DECORATE = 71,
    MEMBER_DECORATE = 72,
    DECORATION_GROUP = 73,
    GROUP_MEMBER_DECORATE = 75,
    EXECUTION_MODE_ID = 331
};

enum decoration {
    ARRAY_STRIDE = 6,
    MATRIX_STRIDE = 7,
    BUILT_IN = 11,
    NON_WRITABLE = 24,
    NON_READABLE = 25,
    BINDING = 33,
    SET = 34,
    OFFSET = 35
};
enum storage { INPUT = 1, WORKGROUP = 4, PRIVATE = 6, IN_FUNCTION = 7, PUSH_CONSTANT = 9, STORAGE_BUFFER = 12 };
enum { MATRIX = 0, SHADER = 1, LOGICAL = 0, GLSL450 = 1, COMPUTE = 5, LOCAL_SIZE = 17, WORKGROUP_SIZE = 25, LOCAL_SIZE_ID = 38 };

/* Declaration of an id. */
struct id {
    uint16_t kind; /* enum opcode; 0: irrelevant */
    bool non_writable, non_readable;
    uint32_t size;  /* of a type, bytes; 0xffffffff: that or more */
    uint32_t value; /* a constant's value; the type a pointer points to; the number of members of a struct */
    uint32_t set, binding;
    uint32_t stride; /* array stride */
};

struct member {
    uint32_t type, index, decoration, value;
};

struct module {
    const struct pell_shader *builtin;
    const uint32_t *words;
    size_t count; /* words */
    struct id *ids;
    uint32_t num_ids, num_members, num_structs;
    struct member *members;
    uint32_t entries, entry, last, functions; /* the entry's function; the last instruction; functions begun and not ended */
    uint32_t local[3], push_size, shared_size, private_size;
    uint32_t built_in; /* the constant that overrides the workgroup size `local`; 0: none */
    uint32_t bindings; /* bit mask of declared bindings */
    bool has_memory_model, local_known, local_by_id, built_in_known, has_push_constants;
};

static struct id *id_of(const struct module *m, uint32_t id)
{
    return id < m->num_ids ? &m->ids[id] : NULL;
}

static uint32_t size_of(const struct module *m, uint32_t type)
{
    return type < m->num_ids ? m->ids[type].size : 0;
}

static uint32_t saturating_product(uint32_t size, uint32_t count)
{
    const uint64_t all = (uint64_t) size * count;

    return all < UINT32_MAX ? (uint32_t) all : UINT32_MAX;
}

static uint32_t saturating_sum(uint32_t a, uint32_t b)
{
    return a < UINT32_MAX - b ? a + b : UINT32_MAX;
}

static bool is_text(const uint32_t *words, size_t count, const char *text)
{
    return count * sizeof(*words) > strlen(text) && memcmp(words, text, strlen(text) + 1) == 0;
}

static uint32_t struct_size(const struct module *m, uint32_t type, const uint32_t *members, uint32_t count)
{
    uint32_t size = 0, end = 0;

    for (uint32_t i = 0; i < count; i++)
        size = saturating_sum(size, size_of(m, members[i]));
    for (uint32_t i = 0; i < m->num_members; i++)
        if (m->members[i].type == type && m->members[i].decoration == MATRIX_STRIDE)
            size = saturating_sum(size, saturating_product(m->members[i].value, 4)); /* columns or rows, at most */
        else if (m->members[i].type == type && m->members[i].decoration == OFFSET && m->members[i].index < count) {
            const uint32_t to = saturating_sum(m->members[i].value, size_of(m, members[m->members[i].index]));
            end = to > end ? to : end;
        }
    return size > end ? size : end;
}

/* Whether all members of a block have this decoration. */
static bool members_are(const struct module *m, uint32_t type, enum decoration decoration)
{
    uint64_t found = 0; /* bits of members */

    for (uint32_t i = 0; i < m->num_members; i++)
        if (m->members[i].type == type && m->members[i].decoration == (uint32_t) decoration && m->members[i].index < MAX_BLOCK_MEMBERS)
            found |= (uint64_t) 1 << m->members[i].index;
    return m->ids[type].value > 0 && m->ids[type].value <= MAX_BLOCK_MEMBERS &&
           found == UINT64_MAX >> (MAX_BLOCK_MEMBERS - m->ids[type].value);
}

/* --- Declarations: each function returns an error text, or NULL ---------------------------------------------------------------- */

static const char *parse_buffer(struct module *m, const struct id *variable, uint32_t type)
{
    int access;

    if (type >= m->num_ids || m->ids[type].kind != TYPE_STRUCT)
        return "has a buffer that is no block";
    if (variable->set != 0 || variable->binding >= (uint32_t) m->builtin->num_bindings)
        return "has a buffer at a binding that the built-in shader has none at";
    if (m->bindings >> variable->binding & 1u)
        return "has two buffers at one binding";
    m->bindings |= 1u << variable->binding;
    access = (variable->non_readable || members_are(m, type, NON_READABLE) ? 0 : PELL_GPU_READS) |
             (variable->non_writable || members_are(m, type, NON_WRITABLE) ? 0 : PELL_GPU_WRITES);
    return access & ~m->builtin->access[variable->binding] ? "reads or writes a buffer that the built-in shader does not" : NULL;
}

static const char *parse_variable(struct module *m, const uint32_t *a)
{
    const struct id *pointer = id_of(m, a[0]), *variable = id_of(m, a[1]);

    if (!pointer || !variable || pointer->kind != TYPE_POINTER)
        return "has a variable without a type";
    switch (a[2]) {
    case INPUT: return NULL;
    case PRIVATE:
    case IN_FUNCTION:
        m->private_size = saturating_sum(m->private_size, size_of(m, pointer->value));
        return m->private_size > MAX_PRIVATE ? "has more than 32 KiB of variables of its own" : NULL;
    case WORKGROUP:
        m->shared_size = saturating_sum(m->shared_size, size_of(m, pointer->value));
        return m->shared_size > MAX_SHARED ? "shares more memory in a workgroup than 16 KiB" : NULL;
    case PUSH_CONSTANT:
        m->push_size = size_of(m, pointer->value);
        if (m->has_push_constants || m->push_size > m->builtin->push_size)
            return "has other push constants than the built-in shader";
        m->has_push_constants = true;
        return NULL;
    case STORAGE_BUFFER: return parse_buffer(m, variable, pointer->value);
    default: return "has variables other than buffers and push constants";
    }
}

/* `n` words after the first. */
static const char *parse_type(struct module *m, uint32_t op, const uint32_t *a, size_t n)
{
    struct id *type = id_of(m, a[0]);
    const struct id *length = op == TYPE_ARRAY && n > 2 ? id_of(m, a[2]) : NULL;

    if (!type || type->kind)
        return "declares an id twice, or beyond its bound";
    type->kind = (uint16_t) op;
    switch (op) {
    case TYPE_INT:
    case TYPE_FLOAT: type->size = n > 1 ? a[1] / 8 : 0; break;
    case TYPE_BOOL: type->size = 4; break;
    case TYPE_VECTOR:
    case TYPE_MATRIX: type->size = n > 2 ? saturating_product(size_of(m, a[1]), a[2]) : 0; break;
    case TYPE_ARRAY: /* sized by a specialisation constant: the length is unknown */
        type->size = size_of(m, a[1]) > type->stride ? size_of(m, a[1]) : type->stride;
        type->size = length && length->kind == CONSTANT ? saturating_product(type->size, length->value) : UINT32_MAX;
        break;
    case TYPE_STRUCT:
        if (++m->num_structs > MAX_STRUCTS)
            return "has too many structs";
        type->value = (uint32_t) n - 1;
        type->size = struct_size(m, a[0], a + 1, type->value);
        break;
    case TYPE_POINTER: type->value = n > 2 ? a[2] : 0; break;
    default: break;
    }
    return NULL;
}

static const char *parse_decoration(struct module *m, const uint32_t *a, size_t n)
{
    struct id *id = id_of(m, a[0]);

    if (!id)
        return "decorates an id beyond its bound";
    if (a[1] == NON_WRITABLE)
        id->non_writable = true;
    if (a[1] == NON_READABLE)
        id->non_readable = true;
    if (n < 3)
        return NULL;
    if ((a[1] == SET && id->set != NO_BINDING) || (a[1] == BINDING && id->binding != NO_BINDING) || (a[1] == ARRAY_STRIDE && id->stride) ||
        (a[1] == BUILT_IN && a[2] == WORKGROUP_SIZE && m->built_in))
        return "decorates something twice";
    if (a[1] == SET)
        id->set = a[2];
    if (a[1] == BINDING)
        id->binding = a[2];
    if (a[1] == ARRAY_STRIDE)
        id->stride = a[2];
    if (a[1] == BUILT_IN && a[2] == WORKGROUP_SIZE)
        m->built_in = a[0];
    return NULL;
}

static const char *parse_member(struct module *m, const uint32_t *a, size_t n)
{
    if (a[2] != OFFSET && a[2] != MATRIX_STRIDE && a[2] != NON_READABLE && a[2] != NON_WRITABLE)
        return NULL;
    if (m->num_members == MAX_MEMBERS)
        return "has too many members of structs";
    m->members[m->num_members++] = (struct member) { a[0], a[1], a[2], n > 3 ? a[3] : 0 };
    return NULL;
}

static const char *parse_mode(struct module *m, const uint32_t *a, size_t n, bool by_id)
{
    if (n < 5 || a[1] != (by_id ? LOCAL_SIZE_ID : LOCAL_SIZE))
        return NULL;
    if (m->local_known)
        return "has two sizes of a workgroup";
    m->local_known = true;
    m->local_by_id = by_id;
    memcpy(m->local, a + 2, sizeof(m->local));
    return NULL;
}

/* A constant decorated as the workgroup size overrides that of the entry point. */
static const char *parse_composite(struct module *m, const uint32_t *a, size_t n)
{
    if (a[1] != m->built_in || m->built_in == 0)
        return NULL;
    m->built_in_known = n == 5 && !m->built_in_known;
    for (size_t k = 0; k < 3 && m->built_in_known; k++) {
        const struct id *id = id_of(m, a[2 + k]);
        m->built_in_known = id && id->kind == CONSTANT && id->value == m->builtin->local[k];
    }
    return m->built_in_known ? NULL : "has another workgroup than the built-in shader";
}

/* An instruction of `n` words after the first. */
static const char *parse_instruction(struct module *m, uint32_t op, const uint32_t *a, size_t n)
{
    static const uint8_t least[EXECUTION_MODE_ID + 1] = {
        [EXTENSION] = 1,       [EXT_INST_IMPORT] = 2,   [MEMORY_MODEL] = 2,       [ENTRY_POINT] = 3,        [EXECUTION_MODE] = 2,
        [CAPABILITY] = 1,      [TYPE_BOOL] = 1,         [TYPE_INT] = 2,           [TYPE_FLOAT] = 2,         [TYPE_VECTOR] = 3,
        [TYPE_MATRIX] = 3,     [TYPE_ARRAY] = 3,        [TYPE_RUNTIME_ARRAY] = 2, [TYPE_STRUCT] = 1,        [TYPE_POINTER] = 3,
        [CONSTANT] = 3,        [FUNCTION] = 4,          [VARIABLE] = 3,           [CONSTANT_COMPOSITE] = 2, [DECORATE] = 2,
        [MEMBER_DECORATE] = 3, [EXECUTION_MODE_ID] = 2,
    };
    struct id *id;

    if (op <= EXECUTION_MODE_ID && n < least[op])
        return "is cut off within an instruction";
    switch (op) {
    case CAPABILITY: return a[0] == MATRIX || a[0] == SHADER ? NULL : "needs capabilities that the device was not asked for";
    case EXTENSION: return "needs an extension";
    case EXT_INST_IMPORT: return is_text(a + 1, n - 1, "GLSL.std.450") ? NULL : "imports other instructions than GLSL.std.450";
    case MEMORY_MODEL:
        m->has_memory_model = a[0] == LOGICAL && a[1] == GLSL450;
        return m->has_memory_model ? NULL : "has a memory model other than GLSL450";
    case ENTRY_POINT:
        m->entries++;
        m->entry = a[1];
        return m->entries == 1 && a[0] == COMPUTE && is_text(a + 2, n - 2, "main") ? NULL : "is no compute shader with the one entry main";
    case EXECUTION_MODE: return parse_mode(m, a, n, false);
    case EXECUTION_MODE_ID: return parse_mode(m, a, n, true);
    case DECORATE: return parse_decoration(m, a, n);
    case MEMBER_DECORATE: return parse_member(m, a, n);
    case TYPE_BOOL:
    case TYPE_INT:
    case TYPE_FLOAT:
    case TYPE_VECTOR:
    case TYPE_MATRIX:
    case TYPE_ARRAY:
    case TYPE_RUNTIME_ARRAY:
    case TYPE_STRUCT:
    case TYPE_POINTER: return parse_type(m, op, a, n);
    case CONSTANT:
        id = id_of(m, a[1]);
        if (!id || id->kind)
            return "declares an id twice, or beyond its bound";
        id->kind = CONSTANT;
        id->value = a[2];
        return NULL;
    case CONSTANT_COMPOSITE: return parse_composite(m, a, n);
    case DECORATION_GROUP:
    case GROUP_MEMBER_DECORATE - 1:
    case GROUP_MEMBER_DECORATE: return "decorates groups";
    case VARIABLE: return parse_variable(m, a);
    case FUNCTION:
        id = id_of(m, a[1]);
        if (!id || id->kind || m->functions++ > 0)
            return "has damaged functions";
        id->kind = FUNCTION;
        return NULL;
    case FUNCTION_END: return m->functions-- == 1 ? NULL : "has damaged functions";
    default: return NULL;
    }
}

static const char *check_local(const struct module *m)
{
    if (m->built_in && !m->built_in_known)
        return "has another workgroup than the built-in shader";
    for (int k = 0; k < 3; k++) {
        const struct id *id = m->local_by_id ? id_of(m, m->local[k]) : NULL;
        const uint32_t size = !m->local_by_id ? m->local[k] : id && id->kind == CONSTANT ? id->value : 0;
        if (!m->local_known || size != m->builtin->local[k])
            return "has another workgroup than the built-in shader";
    }
    return NULL;
}

static const char *check_all(struct module *m)
{
    const char *why = NULL;
    const struct id *entry;

    for (size_t at = HEADER; at < m->count && !why;) {
        const uint32_t length = m->words[at] >> 16, op = m->words[at] & 0xffffu;
        if (length == 0 || length > m->count - at)
            return "is cut off within an instruction";
        why = parse_instruction(m, op, m->words + at + 1, length - 1);
        m->last = op;
        at += length;
    }
    entry = id_of(m, m->entry);
    return why                    ? why
           : !m->has_memory_model ? "has no memory model"
           : m->entries == 0      ? "is no compute shader with the one entry main"
           : m->functions != 0 || m->last != FUNCTION_END || !entry || entry->kind != FUNCTION ? "has damaged functions"
                                                                                               : check_local(m);
}

static const char *check_header(const uint32_t *words, size_t size)
{
    return size < HEADER * sizeof(*words) || size % sizeof(*words) != 0 || size > PELL_SPIRV_MAX
               ? "is not between 20 bytes and 4 MiB of words"
           : words[0] == 0x03022307u                                              ? "is of the other byte order"
           : words[0] != 0x07230203u                                              ? "is no SPIR-V"
           : words[1] < 0x00010000u || words[1] > 0x00010600u || words[1] & 0xffu ? "is of a version other than 1.0 to 1.6"
           : words[3] == 0 || words[3] > MAX_IDS || words[4] != 0                 ? "has a damaged header"
                                                                                  : NULL;
}

enum pell_result pell_spirv_check(struct pell_context *ctx, const uint32_t *words, size_t size, const struct pell_shader *builtin,
                                  const char **why)
{
    struct module m = { .builtin = builtin, .words = words, .count = size / sizeof(*words) };

    *why = check_header(words, size);
    if (*why)
        return PELL_OK;
    m.num_ids = words[3];
    m.ids = pell_calloc(ctx, m.num_ids, sizeof(*m.ids));
    m.members = pell_calloc(ctx, MAX_MEMBERS, sizeof(*m.members));
    if (!m.ids || !m.members) {
        pell_free(ctx, m.ids);
        pell_free(ctx, m.members);
        return PELL_ERR_NOMEM;
    }
    for (uint32_t i = 0; i < m.num_ids; i++)
        m.ids[i].set = m.ids[i].binding = (uint32_t) NO_BINDING;
    *why = check_all(&m);
    pell_free(ctx, m.members);
    pell_free(ctx, m.ids);
    return PELL_OK;
}
