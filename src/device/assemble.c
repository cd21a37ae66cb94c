#include "src/base/file.h"
#include "src/base/memory.h"
#include "src/device/kernel_sources.h"

#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_FILES = 64, MAX_NAME = 128, MAX_NESTING = 32, MAX_FILE_BYTES = 4 << 20 };

struct assembly {
    const char *dir;
    char *text;
    size_t size, capacity;
    size_t seen_count;
    char seen[MAX_FILES][MAX_NAME];
};

static kl_status append(struct assembly *a, const char *text, size_t size, struct kl_err *err)
{
    kl_status st = kl_grow_array(&a->text, &a->capacity, a->size + size + 1, 1, err);

    if (st != KL_OK) return st;
    memcpy(a->text + a->size, text, size);
    a->size += size;
    a->text[a->size] = '\0';
    return KL_OK;
}

static kl_status append_line_directive(struct assembly *a, unsigned int line, const char *name,
                                       struct kl_err *err)
{
    char text[MAX_NAME + 32];
    const int n = snprintf(text, sizeof text, "#line %u \"%s\"\n", line, name);
    return append(a, text, (size_t)n, err);
}

/* The bytes of a source: *owned is to be freed, and NULL where they are built in. */
static kl_status find_source(const struct assembly *a, const char *name, const char **text,
                             size_t *size, char **owned, struct kl_err *err)
{
    char path[4096];

    *owned = NULL;
    if (a->dir != NULL) {
        const char *slash = strrchr(name, '/');
        (void)snprintf(path, sizeof path, "%s/%s", a->dir, slash != NULL ? slash + 1 : name);
        kl_status st = kl_file_read(path, MAX_FILE_BYTES, owned, size, err);
        *text = *owned;
        return st;
    }
    for (const struct kl_kernel_source *s = kl_kernel_sources; s->name != NULL; ++s) {
        if (strcmp(s->name, name) != 0) continue;
        *text = (const char *)s->text;
        *size = s->size;
        return KL_OK;
    }
    return kl_fail(err, KL_ERR_INPUT, "%s: no such kernel source", name);
}

/* Is the line an `#include "name"`? Then *name is filled. */
static bool is_include(const char *line, size_t size, char name[MAX_NAME])
{
    static const char prefix[] = "#include \"";
    const size_t skip = sizeof prefix - 1;

    if (size <= skip || memcmp(line, prefix, skip) != 0) return false;
    const char *end = memchr(line + skip, '"', size - skip);
    if (end == NULL) return false;
    const size_t length = (size_t)(end - line) - skip;
    if (length >= MAX_NAME) return false;
    memcpy(name, line + skip, length);
    name[length] = '\0';
    return true;
}

/* A file already in the text is left out: all have guards, and bvh.h and trace.h name each other.
 */
static kl_status mark_seen(struct assembly *a, const char *name, bool *is_new, struct kl_err *err)
{
    *is_new = false;
    for (size_t i = 0; i < a->seen_count; ++i) {
        if (strcmp(a->seen[i], name) == 0) return KL_OK;
    }
    if (a->seen_count == MAX_FILES) {
        return kl_fail(err, KL_ERR_INPUT, "%s: more than %d kernel sources", name, MAX_FILES);
    }
    (void)snprintf(a->seen[a->seen_count++], MAX_NAME, "%s", name);
    *is_new = true;
    return KL_OK;
}

static kl_status add_file(struct assembly *a, const char *name, int nesting, struct kl_err *err);

static kl_status add_lines(struct assembly *a, const char *name, const char *text, size_t size,
                           int nesting, struct kl_err *err)
{
    unsigned int line = 1;
    kl_status st = append_line_directive(a, line, name, err);

    for (size_t at = 0; st == KL_OK && at < size; ++line) {
        const char *start = text + at;
        const char *newline = memchr(start, '\n', size - at);
        const size_t length = newline != NULL ? (size_t)(newline - start) + 1 : size - at;
        char included[MAX_NAME];
        at += length;
        if (!is_include(start, length, included)) {
            st = append(a, start, length, err);
            if (st == KL_OK && newline == NULL) st = append(a, "\n", 1, err);
            continue;
        }
        st = add_file(a, included, nesting + 1, err);
        if (st == KL_OK) st = append_line_directive(a, line + 1, name, err);
    }
    return st;
}

/* Recursion is as deep as includes nest: at most MAX_NESTING. */
static kl_status add_file(struct assembly *a, const char *name, int nesting, struct kl_err *err)
{
    const char *text = NULL;
    char *owned = NULL;
    size_t size = 0;
    bool is_new = false;

    if (nesting > MAX_NESTING) {
        return kl_fail(err, KL_ERR_INPUT, "%s: includes nest too deep", name);
    }
    kl_status st = mark_seen(a, name, &is_new, err);
    if (st != KL_OK || !is_new) return st;
    st = find_source(a, name, &text, &size, &owned, err);
    if (st == KL_OK) st = add_lines(a, name, text, size, nesting, err);
    free(owned);
    return st;
}

kl_status kl_kernel_assemble(const char *file, const char *dir, char **out, struct kl_err *err)
{
    /* The host never contracts a * b + c either: results are compared bit by bit. */
    static const char head[] = "#pragma OPENCL FP_CONTRACT OFF\n";
    struct assembly *a = NULL;
    kl_status st = kl_alloc_array(&a, 1, sizeof *a, err);

    if (st != KL_OK) return st;
    a->dir = dir;
    st = append(a, head, sizeof head - 1, err);
    if (st == KL_OK) st = add_file(a, file, 0, err);
    if (st == KL_OK) {
        *out = a->text;
        a->text = NULL;
    }
    free(a->text);
    free(a);
    return st;
}
