// Where bytes come from: files, data URIs and the GLB container (glTF 2.0 section 4.4).
#include "src/import/gltf_impl.hpp"

#include <cerrno>
#include <cstdio>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

namespace
{
// A file larger than this is not a scene but an accident.
const uint64_t max_file_bytes = uint64_t(1) << 36;

[[noreturn]] void refuse_io(const char *verb)
{
    kl_err err = {};
    (void)kl_fail_errno(&err, "cannot %s", verb);
    // A name that leads nowhere is the scene's fault, anything else the system's.
    if (err.os_error == ENOENT || err.os_error == ENOTDIR) err.status = KL_ERR_INPUT;
    throw kl_import_failure(err);
}

struct open_file {
    int fd;
    ~open_file()
    {
        if (fd >= 0) (void)close(fd);
    }
};

int hex_value(char c)
{
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
}

std::string decode_percent(const std::string &text)
{
    std::string out;
    for (size_t i = 0; i < text.size(); ++i) {
        const bool escape = text[i] == '%' && i + 2 < text.size() && hex_value(text[i + 1]) >= 0 &&
                            hex_value(text[i + 2]) >= 0;
        if (escape) {
            out += static_cast<char>(hex_value(text[i + 1]) * 16 + hex_value(text[i + 2]));
            i += 2;
        } else {
            out += text[i];
        }
    }
    return out;
}

int base64_value(char c)
{
    if (c >= 'A' && c <= 'Z') return c - 'A';
    if (c >= 'a' && c <= 'z') return c - 'a' + 26;
    if (c >= '0' && c <= '9') return c - '0' + 52;
    if (c == '+' || c == '-') return 62;
    if (c == '/' || c == '_') return 63;
    return -1;
}

std::vector<unsigned char> decode_base64(const std::string &text, size_t begin)
{
    std::vector<unsigned char> out;
    uint32_t bits = 0;
    unsigned have = 0;

    size_t end = text.size();
    while (end > begin && text[end - 1] == '=') {
        --end;
    }
    out.reserve((end - begin) / 4 * 3 + 3);
    for (size_t i = begin; i < end; ++i) {
        const int v = base64_value(text[i]);
        if (v < 0) {
            kl_import_refuse("data URI: byte 0x%02x at %zu, expected base64",
                             static_cast<unsigned>(static_cast<unsigned char>(text[i])), i);
        }
        bits = (bits << 6 | static_cast<uint32_t>(v)) & 0xffffffu;
        have += 6;
        if (have >= 8) {
            have -= 8;
            out.push_back(static_cast<unsigned char>(bits >> have & 0xffu));
        }
    }
    return out;
}

std::vector<unsigned char> decode_data_uri(const std::string &uri)
{
    const std::string marker = ";base64";
    const size_t comma = uri.find(',');

    if (comma == std::string::npos) kl_import_refuse("data URI without a comma");
    const bool base64 =
        comma >= marker.size() && uri.compare(comma - marker.size(), marker.size(), marker) == 0;
    if (base64) return decode_base64(uri, comma + 1);
    const std::string text = decode_percent(uri.substr(comma + 1));
    return std::vector<unsigned char>(text.begin(), text.end());
}

// "http:", "file:" and so on, but not "C:": RFC 3986 section 3.1.
bool has_scheme(const std::string &uri)
{
    size_t i = 0;
    while (i < uri.size() && (isalnum(static_cast<unsigned char>(uri[i])) != 0 || uri[i] == '+' ||
                              uri[i] == '-' || uri[i] == '.')) {
        ++i;
    }
    return i > 1 && i < uri.size() && uri[i] == ':';
}

uint32_t read_u32(const unsigned char *p)
{
    return static_cast<uint32_t>(p[0]) | static_cast<uint32_t>(p[1]) << 8 |
           static_cast<uint32_t>(p[2]) << 16 | static_cast<uint32_t>(p[3]) << 24;
}
} // namespace

std::vector<unsigned char> kl_gltf_read_file(const std::string &path)
{
    // O_NONBLOCK: opening a pipe must not wait for a writer.
    open_file file = {open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)};
    struct stat info = {};

    if (file.fd < 0) refuse_io("open");
    if (fstat(file.fd, &info) != 0) refuse_io("read");
    if (!S_ISREG(info.st_mode)) kl_import_refuse("not a regular file");
    const uint64_t size = static_cast<uint64_t>(info.st_size);
    if (size > max_file_bytes)
        kl_import_refuse("%llu bytes are too many", static_cast<unsigned long long>(size));
    std::vector<unsigned char> bytes(static_cast<size_t>(size));
    size_t done = 0;
    while (done < bytes.size()) {
        const ssize_t n = read(file.fd, bytes.data() + done, bytes.size() - done);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) refuse_io("read");
        if (n == 0) break;
        done += static_cast<size_t>(n);
    }
    bytes.resize(done);
    return bytes;
}

// Chunk by chunk: JSON first, then at most one BIN that counts; unknown chunks are skipped.
static kl_gltf_chunks split_glb(kl_gltf_import &in, const unsigned char *bytes, size_t size)
{
    const uint32_t type_json = 0x4e4f534au, type_bin = 0x004e4942u;
    kl_gltf_chunks chunks = {nullptr, nullptr, 0, 0};

    if (size < 12) kl_import_refuse("GLB header: %zu bytes, expected 12", size);
    const uint32_t version = read_u32(bytes + 4), length = read_u32(bytes + 8);
    if (version != 2) kl_import_refuse("GLB version %u, expected 2", version);
    if (length > size) {
        kl_import_refuse("GLB length %u, but the file has %zu bytes", length, size);
    }
    if (length < size) {
        kl_gltf_warn(in, "GLB: %zu bytes after its end are ignored", size - length);
    }
    size_t at = 12;
    while (at < length) {
        if (length - at < 8) kl_import_refuse("GLB: chunk header cut off at byte %zu", at);
        const uint32_t chunk_size = read_u32(bytes + at), type = read_u32(bytes + at + 4);
        at += 8;
        if (chunk_size > length - at) {
            kl_import_refuse("GLB: chunk of %u bytes at byte %zu, only %zu left", chunk_size,
                             at - 8, length - at);
        }
        if (chunks.json == nullptr) {
            if (type != type_json) {
                kl_import_refuse("GLB: first chunk has type 0x%08x, expected JSON", type);
            }
            chunks.json = bytes + at;
            chunks.json_size = chunk_size;
        } else if (type == type_bin && chunks.bin == nullptr) {
            chunks.bin = bytes + at;
            chunks.bin_size = chunk_size;
        }
        at += chunk_size;
    }
    if (chunks.json == nullptr) kl_import_refuse("GLB without a JSON chunk");
    return chunks;
}

kl_gltf_chunks kl_gltf_split(kl_gltf_import &in, const unsigned char *bytes, size_t size)
{
    if (size == 0) kl_import_refuse("the file is empty, expected glTF 2.0");
    if (size >= 4 && std::memcmp(bytes, "glTF", 4) == 0) return split_glb(in, bytes, size);
    return kl_gltf_chunks{bytes, nullptr, size, 0};
}

kl_gltf_blob kl_gltf_read_uri(const kl_gltf_import &in, const std::string &uri)
{
    kl_gltf_blob blob;

    try {
        if (uri.compare(0, 5, "data:") == 0) {
            blob.bytes = decode_data_uri(uri);
        } else if (has_scheme(uri)) {
            kl_import_refuse("uri \"%.200s\": expected a file or data URI", uri.c_str());
        } else if (!in.files_allowed) {
            kl_import_refuse("uri \"%.200s\": there are no files beside this scene", uri.c_str());
        } else {
            const std::string name = decode_percent(uri);
            if (name.empty() || name.find('\0') != std::string::npos) {
                kl_import_refuse("uri \"%.200s\": expected a file name", uri.c_str());
            }
            blob.bytes = kl_gltf_read_file(name[0] == '/' ? name : in.base_dir + name);
        }
    } catch (const kl_import_failure &e) {
        blob.failed = true;
        blob.why = e.err;
        if (e.err.os_error != 0) (void)kl_wrap(&blob.why, "%.200s", uri.c_str());
    }
    blob.size = blob.bytes.size();
    return blob;
}
