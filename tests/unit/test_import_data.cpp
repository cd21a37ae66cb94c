// Every scene of $KEEPLIGHT_DATA (else ../shared beside the repository): valid files load, and
// broken ones obey the validator's verdicts in EXPECTED.tsv.
#include "src/import/import.h"

#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

extern "C" { // the header has no guard of its own
#include <cmocka.h>
}

namespace
{
namespace fs = std::filesystem;

fs::path find_scenes()
{
    const char *data = std::getenv("KEEPLIGHT_DATA");
    return (data != nullptr ? fs::path(data) : fs::path(KL_SOURCE_DIR) / ".." / "shared") /
           "scenes";
}

bool have_scenes()
{
    if (fs::is_directory(find_scenes())) return true;
    print_message("skipped: no scenes at %s (set KEEPLIGHT_DATA)\n", find_scenes().c_str());
    return false;
}

struct outcome {
    kl_status status;
    kl_err err;
    std::vector<std::string> warnings;
};

void keep(void *context, const char *line)
{
    static_cast<outcome *>(context)->warnings.push_back(line);
}

// Also poses and deforms: what was accepted must be safe to use.
outcome import_file(const fs::path &path)
{
    outcome out = {KL_OK, {}, {}};
    kl_scene *scene = nullptr;
    out.status = kl_import_gltf(path.c_str(), keep, &out, &scene, &out.err);
    if (out.status != KL_OK) return out;
    kl_err err = {};
    kl_pose *pose = nullptr;
    assert_int_equal(kl_pose_create(scene, KL_NONE, 0.3, &pose, &err), KL_OK);
    for (uint32_t i = 0; i < scene->instance_count; ++i) {
        kl_deformed deformed = {};
        assert_int_equal(kl_instance_deform(scene, pose, i, &deformed, &err), KL_OK);
        kl_deformed_fini(&deformed);
    }
    kl_pose_destroy(pose);
    kl_scene_destroy(scene);
    return out;
}

bool is_gltf(const fs::path &path)
{
    return path.extension() == ".gltf" || path.extension() == ".glb";
}

// All that is said about files that are valid or nearly so.
bool is_expected_warning(const std::string &line)
{
    const char *const known[] = {"points and lines are not drawn",
                                 "bytes after its end are ignored", "do not sum to 1",
                                 "read as 2.0"};
    for (const char *text : known) {
        if (line.find(text) != std::string::npos) return true;
    }
    return false;
}

void test_valid_scenes(void **)
{
    size_t loaded = 0;
    if (!have_scenes()) skip();
    for (const auto &entry : fs::recursive_directory_iterator(find_scenes())) {
        const std::string name = fs::relative(entry.path(), find_scenes()).string();
        const bool odd = name.rfind("broken/", 0) == 0 || name.rfind("nearly-valid/", 0) == 0;
        if (odd || !is_gltf(entry.path())) continue;
        const outcome out = import_file(entry.path());
        if (name.find("unsupported-required/") != std::string::npos) {
            assert_int_equal(out.status, KL_ERR_INPUT);
            assert_non_null(std::strstr(out.err.msg, "is required by the file and not supported"));
            continue;
        }
        if (out.status != KL_OK) print_message("%s\n", out.err.msg);
        assert_int_equal(out.status, KL_OK);
        for (const std::string &line : out.warnings) {
            if (!is_expected_warning(line)) print_message("%s: %s\n", name.c_str(), line.c_str());
            assert_true(is_expected_warning(line));
        }
        ++loaded;
    }
    assert_true(loaded > 0);
}

// Refused: one line that begins with the path. Without errors in the table: accepted.
void check_verdict(const fs::path &path, int errors)
{
    const outcome out = import_file(path);
    if (out.status == KL_OK) return;
    const std::string message = out.err.msg;
    if (errors == 0) print_message("%s\n", message.c_str());
    assert_true(errors > 0);
    assert_true(out.status == KL_ERR_INPUT || out.status == KL_ERR_IO);
    assert_int_equal(message.rfind(path.string() + ": ", 0), 0);
    assert_true(message.size() > path.string().size() + 10);
    assert_true(message.find('\n') == std::string::npos);
}

void test_broken_scenes(void **)
{
    size_t checked = 0;
    if (!have_scenes()) skip();
    for (const char *folder : {"broken", "broken/validator", "nearly-valid"}) {
        const fs::path base = find_scenes() / folder;
        std::ifstream table(base / "EXPECTED.tsv");
        std::string line;
        (void)std::getline(table, line); // the head
        while (std::getline(table, line)) {
            const size_t tab = line.find('\t');
            if (tab == std::string::npos) continue;
            check_verdict(base / line.substr(0, tab), std::atoi(line.c_str() + tab));
            ++checked;
        }
    }
    assert_true(checked > 0);
}

// Every prefix of a file must be refused or accepted without a crash.
void test_truncated(void **)
{
    if (!have_scenes()) skip();
    const fs::path path = find_scenes() / "fox" / "Fox-quantized.glb";
    std::ifstream file(path, std::ios::binary);
    std::string bytes(static_cast<size_t>(fs::file_size(path)), '\0');
    assert_true(file.read(&bytes[0], static_cast<std::streamsize>(bytes.size())).good());
    for (size_t size = 0; size < bytes.size(); size = size * 5 / 4 + 1) {
        kl_err err = {};
        kl_scene *scene = nullptr;
        const kl_status status =
            kl_import_gltf_memory(bytes.data(), size, "cut.glb", nullptr, nullptr, &scene, &err);
        assert_int_equal(status, KL_ERR_INPUT);
        assert_null(scene);
    }
}

void test_missing_file(void **)
{
    kl_err err = {};
    kl_scene *scene = nullptr;
    assert_int_equal(kl_import_gltf("/nonexistent/a.glb", nullptr, nullptr, &scene, &err),
                     KL_ERR_INPUT);
    assert_int_equal(std::strncmp(err.msg, "/nonexistent/a.glb: cannot open", 31), 0);
    assert_int_equal(kl_import_gltf("/", nullptr, nullptr, &scene, &err), KL_ERR_INPUT);
    assert_null(scene);
}
} // namespace

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_valid_scenes),
        cmocka_unit_test(test_broken_scenes),
        cmocka_unit_test(test_truncated),
        cmocka_unit_test(test_missing_file),
    };
    return cmocka_run_group_tests(tests, nullptr, nullptr);
}
