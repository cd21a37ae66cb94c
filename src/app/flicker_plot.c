#include "src/app/flicker_plot.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <spawn.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

extern char **environ;

static const char *terminal_of(const char *path)
{
    const char *dot = strrchr(path, '.');

    if (dot != NULL && strcmp(dot, ".svg") == 0) return "svg size 900,700 background 'white'";
    if (dot != NULL && strcmp(dot, ".png") == 0) return "pngcairo size 900,700";
    return NULL;
}

kl_status kl_flicker_plot_check(const char *path, struct kl_err *err)
{
    if (terminal_of(path) != NULL) return KL_OK;
    return kl_fail(err, KL_ERR_USAGE, "--plot: '%s' ends neither in .svg nor in .png", path);
}

/* In single quotes, which gnuplot doubles; "./" keeps it from reading "|name" as a command. */
static void put_name(FILE *f, const char *path)
{
    (void)fprintf(f, "'%s", path[0] == '/' ? "" : "./");
    for (const char *p = path; *p != '\0'; ++p) {
        (void)fprintf(f, *p == '\'' ? "''" : "%c", *p);
    }
    (void)fputc('\'', f);
}

static void put_data(FILE *f, const struct kl_coherence_result *r, int32_t first)
{
    (void)fprintf(f, "$steps << END\n");
    for (uint32_t t = 1; t < r->frames; ++t) {
        const struct kl_coherence_step *s = &r->steps[t];
        (void)fprintf(f, "%ld %g %g %g %u\n", (long)first + (long)t, 100.0 * s->step,
                      100.0 * s->reference_step, s->t_relmse, (unsigned)s->pops);
    }
    (void)fprintf(f, "END\n");
}

static void put_script(FILE *f, const char *path, const struct kl_coherence_result *r,
                       int32_t first)
{
    const bool has_reference = !isnan(r->t_relmse);

    put_data(f, r, first);
    (void)fprintf(f, "set datafile missing 'nan'\nset terminal %s\nset output ", terminal_of(path));
    put_name(f, path);
    (void)fprintf(f,
                  "\nset multiplot layout %d,1\nset grid\nset key top right\nset lmargin 12\n"
                  "set xlabel 'frame'\nset yrange [0:*]\n"
                  "set ylabel 'change to the frame before [%%]'\n"
                  "plot $steps using 1:2 with linespoints pt 7 ps 0.4 title 'sequence'%s\n"
                  "set ylabel 'blocks that pop'\n"
                  "plot $steps using 1:5 with impulses lw 2 notitle\n",
                  has_reference ? 3 : 2,
                  has_reference ? ", '' using 1:3 with lines title 'reference'" : "");
    if (has_reference) {
        (void)fprintf(f, "set ylabel 't-relMSE'\nset logscale y\nset yrange [*:*]\n"
                         "set format y '%%.0e'\n"
                         "plot $steps using 1:4 with linespoints pt 7 ps 0.4 notitle\n");
    }
    (void)fprintf(f, "unset multiplot\n");
}

static kl_status run_gnuplot(int script, struct kl_err *err)
{
    char name[] = "gnuplot";
    char *argv[] = {name, NULL};
    posix_spawn_file_actions_t actions;
    pid_t child;
    int status = 0;

    errno = posix_spawn_file_actions_init(&actions);
    if (errno != 0) return kl_fail_errno(err, "gnuplot");
    errno = posix_spawn_file_actions_adddup2(&actions, script, STDIN_FILENO);
    if (errno == 0) {
        errno = posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    }
    if (errno == 0) errno = posix_spawnp(&child, name, &actions, NULL, argv, environ);
    (void)posix_spawn_file_actions_destroy(&actions);
    if (errno == ENOENT) {
        return kl_fail(err, KL_ERR_IO, "--plot: gnuplot is not installed (Debian: gnuplot-nox)");
    }
    if (errno != 0) return kl_fail_errno(err, "gnuplot");
    while (waitpid(child, &status, 0) < 0) {
        if (errno != EINTR) return kl_fail_errno(err, "gnuplot");
    }
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return KL_OK;
    return kl_fail(err, KL_ERR_IO, "--plot: gnuplot failed");
}

kl_status kl_flicker_plot(const char *path, const struct kl_coherence_result *result, int32_t first,
                          struct kl_err *err)
{
    FILE *script = tmpfile();
    kl_status st = KL_OK;

    if (script == NULL) return kl_fail_errno(err, "--plot: no temporary file");
    put_script(script, path, result, first);
    if (fflush(script) != 0 || lseek(fileno(script), 0, SEEK_SET) != 0) {
        st = kl_fail_errno(err, "--plot: temporary file");
    }
    if (st == KL_OK) st = run_gnuplot(fileno(script), err);
    (void)fclose(script);
    return st;
}
