/* Runs a fuzz target over the files of its saved corpus: for builds without libFuzzer. */
#include <dirent.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static int replay_file(const char *path)
{
    FILE *file = fopen(path, "rb");
    if (file == NULL) return 0; /* "." and ".." */
    static uint8_t data[1u << 20];
    const size_t size = fread(data, 1, sizeof data, file);
    (void)fclose(file);
    return LLVMFuzzerTestOneInput(data, size);
}

int main(int argc, char **argv)
{
    if (argc != 2) return 2;
    DIR *dir = opendir(argv[1]);
    if (dir == NULL) return 1;
    size_t count = 0;
    for (const struct dirent *entry = readdir(dir); entry != NULL; entry = readdir(dir)) {
        char path[4096];
        if (entry->d_name[0] == '.') continue;
        (void)snprintf(path, sizeof path, "%s/%s", argv[1], entry->d_name);
        (void)replay_file(path);
        ++count;
    }
    (void)closedir(dir);
    (void)printf("%zu inputs replayed\n", count);
    return count > 0 ? 0 : 1;
}
