/* A file system that fails on command, and forgets on a power cut what was not synced. */
#ifndef KL_TESTS_CRASH_FAULTS_H
#define KL_TESTS_CRASH_FAULTS_H

#include <stdbool.h>
#include <stddef.h>

enum fault_kind {
    FAULT_NONE,
    FAULT_ERROR,     /* the call fails with errno `error` */
    FAULT_SHORT,     /* read and write do one byte */
    FAULT_POWER_CUT, /* the call takes effect, then every later one fails */
};

struct fault_plan {
    enum fault_kind kind;
    int at;     /* number of the call, from 0; -1: all of them (FAULT_SHORT) */
    bool lasts; /* calls after `at` fail too */
    int error;
};

/* Watch the directory `dir`, whose present content is durable, and follow the plan. */
void faults_begin(const char *dir, const struct fault_plan *plan);
/* Calls made since; what kind the planned one was ("": it was not reached). */
int faults_call_count(void);
const char *faults_hit(void);
/* Back to the system's calls. What is known stays for faults_outcome. */
void faults_end(void);

/* After a power cut the directory may be in one of several states: outcome i is written to the
 * empty folder `to`. False: there are no more. */
bool faults_outcome(int i, const char *to);

#endif
