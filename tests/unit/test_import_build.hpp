// Small glTF documents written in code: accessors are appended to one data URI buffer.
#ifndef KL_TESTS_UNIT_TEST_IMPORT_BUILD_HPP
#define KL_TESTS_UNIT_TEST_IMPORT_BUILD_HPP

#include "src/import/import.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include <csetjmp>
#include <cstdarg>
#include <cstddef>

extern "C" { // the header has no guard of its own
#include <cmocka.h>
}

enum { U8 = 5121, I8 = 5120, U16 = 5123, I16 = 5122, U32 = 5125, F32 = 5126 };

struct test_gltf {
    std::string bytes, views, accessors, rest;

    static std::string base64(const std::string &in)
    {
        const char *digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
        std::string out;
        for (size_t i = 0; i < in.size(); i += 3) {
            uint32_t word = 0;
            for (size_t k = 0; k < 3; ++k) {
                word = word << 8 | (i + k < in.size() ? static_cast<unsigned char>(in[i + k]) : 0u);
            }
            for (size_t k = 0; k < 4; ++k) {
                out += i + k > in.size() ? '=' : digits[word >> (18 - 6 * k) & 63u];
            }
        }
        return out;
    }

    template <class T> int add_view(const std::vector<T> &values, int stride = 0)
    {
        const size_t offset = (bytes.size() + 3) / 4 * 4;
        bytes.resize(offset);
        bytes.append(reinterpret_cast<const char *>(values.data()), values.size() * sizeof(T));
        if (!views.empty()) views += ",";
        views += "{\"buffer\":0,\"byteOffset\":" + std::to_string(offset) +
                 ",\"byteLength\":" + std::to_string(values.size() * sizeof(T));
        if (stride > 0) views += ",\"byteStride\":" + std::to_string(stride);
        views += "}";
        return view_count++;
    }

    // `extra`: further members, beginning with a comma.
    int add_accessor(int view, int component, const std::string &type, size_t count,
                     const std::string &extra = "")
    {
        if (!accessors.empty()) accessors += ",";
        accessors += "{\"componentType\":" + std::to_string(component) + ",\"type\":\"" + type +
                     "\",\"count\":" + std::to_string(count);
        if (view >= 0) accessors += ",\"bufferView\":" + std::to_string(view);
        accessors += extra + "}";
        return accessor_count++;
    }

    template <class T>
    int add(const std::vector<T> &values, int component, const std::string &type, size_t count,
            const std::string &extra = "")
    {
        return add_accessor(add_view(values), component, type, count, extra);
    }

    std::string text() const
    {
        std::string out = "{\"asset\":{\"version\":\"2.0\"}";
        if (!bytes.empty()) {
            out += ",\"buffers\":[{\"byteLength\":" + std::to_string(bytes.size()) +
                   ",\"uri\":\"data:application/octet-stream;base64," + base64(bytes) + "\"}]";
        }
        if (!views.empty()) out += ",\"bufferViews\":[" + views + "]";
        if (!accessors.empty()) out += ",\"accessors\":[" + accessors + "]";
        return out + rest + "}";
    }

    // One mesh of one primitive at one node.
    void add_mesh(const std::string &primitive)
    {
        rest += ",\"meshes\":[{\"primitives\":[{" + primitive + "}]}],\"nodes\":[{\"mesh\":0}]";
    }

  private:
    int view_count = 0, accessor_count = 0;
};

// An import and what it said.
struct test_import {
    kl_scene *scene = nullptr;
    kl_err err = {};
    kl_status status = KL_OK;
    std::vector<std::string> warnings;

    static void keep(void *context, const char *line)
    {
        static_cast<test_import *>(context)->warnings.push_back(line);
    }
    explicit test_import(const std::string &text)
    {
        status =
            kl_import_gltf_memory(text.data(), text.size(), "t.gltf", keep, this, &scene, &err);
    }
    explicit test_import(const test_gltf &gltf) : test_import(gltf.text())
    {
    }
    ~test_import()
    {
        kl_scene_destroy(scene);
    }
    test_import(const test_import &) = delete;
    test_import &operator=(const test_import &) = delete;

    const kl_mesh &mesh() const
    {
        if (status != KL_OK) print_message("%s\n", err.msg);
        assert_int_equal(status, KL_OK);
        assert_int_equal(scene->mesh_count, 1);
        return scene->meshes[0];
    }
    // Refused with a message that begins with the path and holds `part`.
    void assert_refused(const char *part) const
    {
        assert_int_equal(status, KL_ERR_INPUT);
        if (std::strstr(err.msg, part) == nullptr) print_message("%s\n", err.msg);
        assert_non_null(std::strstr(err.msg, part));
        assert_int_equal(std::strncmp(err.msg, "t.gltf: ", 8), 0);
    }
    void assert_warned(const char *part) const
    {
        if (status != KL_OK) print_message("%s\n", err.msg);
        assert_int_equal(status, KL_OK);
        size_t found = 0;
        for (const std::string &line : warnings) {
            if (line.find(part) != std::string::npos) ++found;
        }
        assert_int_equal(found, 1);
    }
};

inline void assert_floats(const float *got, const std::vector<double> &expected, double tolerance)
{
    for (size_t i = 0; i < expected.size(); ++i) {
        const double difference = std::fabs(static_cast<double>(got[i]) - expected[i]);
        if (!(difference <= tolerance)) {
            print_message("number %zu: %.9g, expected %.9g\n", i, static_cast<double>(got[i]),
                          expected[i]);
        }
        assert_true(difference <= tolerance);
    }
}

// A unit right triangle in z = 0.
inline std::vector<float> test_triangle()
{
    return {0, 0, 0, 1, 0, 0, 0, 1, 0};
}

// 1 x 1 red PNG.
inline std::string test_png_uri()
{
    return "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGP4"
           "z8AAAAMBAQDJ/pLvAAAAAElFTkSuQmCC";
}

#endif
