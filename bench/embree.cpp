// Traces a ray dump with Embree 3: the peer of `bench/traversal`, which compiles and drives it.
//
//   embree RAYS TRIANGLES DISTANCES [medium|high]
//
// The files are those of `raywave dump-rays` (docs/ray-dumps.md); the last word is the quality of Embree's BVH. Each
// line on stdin is a round, `FORM SCENE THREADS PASSES`: FORM is `single` (rtcIntersect1), `packet8` (rtcIntersect8),
// or `stream` (rtcIntersect1M), or its occluded sibling for shadow rays; SCENE is `fast` or `robust`. The answer is a
// line of JSON: seconds of all passes, rays that hit, rays whose answer is not that of DISTANCES, and rays that are
// excused: their answer is right once a filter leaves out the triangles that they cannot hit.

#include <embree3/rtcore.h>

#include <immintrin.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace {

// Embree cannot leave a triangle out but by a filter, which would slow it down. It hardly ever needs one: a ray starts
// beyond the plane of the triangle that it leaves, by a bound of its own rounding error, and a shadow ray ends as far
// before its lamp. Embree rounds in another way, so this much is cut off a shadow ray, in lengths of its direction. Rays
// along their own plane are left, as from a ceiling to a lamp in it: the filter judges them, after the clock has stopped.
constexpr float SHORTENED = 1e-5f;
// Answers of one ray agree where distances differ by less than this share.
constexpr float TOLERANCE = 1e-3f;
constexpr uint32_t NONE = 0xffffffffu;
// Rays that a thread takes at once; a multiple of 8.
constexpr size_t CHUNK = 1024;

struct Record {
    float origin[3];
    uint32_t leaves;
    float direction[3];
    uint32_t target;
};
static_assert(sizeof(Record) == 32, "docs/ray-dumps.md");

// Eight rays side by side, as Embree's packets have them.
struct alignas(32) Packet {
    float org_x[8], org_y[8], org_z[8], dir_x[8], dir_y[8], dir_z[8], tfar[8];
};

// What a renderer needs of a hit: 16 bytes, as raywave's kernels write them.
struct Answer {
    uint32_t triangle;
    float u, v, distance;
};

[[noreturn]] void fail(const std::string &message) {
    std::fprintf(stderr, "embree: %s\n", message.c_str());
    std::exit(2);
}

std::string read(const char *path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) fail(std::string(path) + ": cannot be read");
    std::stringstream text;
    text << file.rdbuf();
    return text.str();
}

// The numbers of a .npy file of version 1.0 that holds f32.
std::vector<float> read_npy(const char *path) {
    const std::string bytes = read(path);
    if (bytes.size() < 10 || bytes.compare(0, 8, std::string("\x93NUMPY\x01\x00", 8)) != 0 ||
        bytes.find("'<f4'") == std::string::npos)
        fail(std::string(path) + ": this is no .npy file of raywave");
    const size_t start = 10 + (uint8_t(bytes[8]) | uint8_t(bytes[9]) << 8);
    std::vector<float> numbers((bytes.size() - start) / sizeof(float));
    std::memcpy(numbers.data(), bytes.data() + start, numbers.size() * sizeof(float));
    return numbers;
}

// A context for the filter, and the ray that is traced in it.
struct Excluding {
    RTCIntersectContext context;
    const Record *ray;
};

void leave_out(const RTCFilterFunctionNArguments *arguments) {
    const Record *ray = reinterpret_cast<const Excluding *>(arguments->context)->ray;
    const uint32_t triangle = RTCHitN_primID(arguments->hit, arguments->N, 0);
    if (triangle == ray->leaves || triangle == ray->target) arguments->valid[0] = 0;
}

struct Dump {
    bool camera = false, shadow = false;
    std::vector<Record> rays;
};

Dump read_dump(const char *path) {
    const std::string bytes = read(path);
    const size_t first = bytes.find('\n');
    const size_t second = first == std::string::npos ? first : bytes.find('\n', first + 1);
    if (second == std::string::npos || bytes.compare(0, first, "raywave rays 1") != 0)
        fail(std::string(path) + ": this is no ray dump");
    const std::string about = bytes.substr(first + 1, second - first - 1);
    Dump dump;
    dump.camera = about.find("\"class\":\"camera\"") != std::string::npos;
    dump.shadow = about.find("\"class\":\"shadow\"") != std::string::npos;
    dump.rays.resize((bytes.size() - second - 1) / sizeof(Record));
    std::memcpy(dump.rays.data(), bytes.data() + second + 1, dump.rays.size() * sizeof(Record));
    return dump;
}

RTCScene build(RTCDevice device, const std::vector<float> &corners, RTCSceneFlags flags, RTCBuildQuality quality) {
    const size_t triangles = corners.size() / 9;
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    void *vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, 3 * triangles);
    std::memcpy(vertices, corners.data(), corners.size() * sizeof(float));
    auto *indices = static_cast<uint32_t *>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, triangles));
    for (uint32_t i = 0; i < 3 * triangles; ++i) indices[i] = i;
    rtcCommitGeometry(geometry);
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneFlags(scene, flags);
    rtcSetSceneBuildQuality(scene, quality);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene);
    return scene;
}

class Tracer {
public:
    Tracer(Dump dump) : dump_(std::move(dump)) {
        const size_t count = dump_.rays.size();
        packets_.resize((count + 7) / 8);
        for (size_t i = 0; i < 8 * packets_.size(); ++i) {
            // A last packet that is not full repeats the last ray, inactive.
            const Record &ray = dump_.rays[std::min(i, count - 1)];
            Packet &packet = packets_[i / 8];
            const size_t lane = i % 8;
            packet.org_x[lane] = ray.origin[0];
            packet.org_y[lane] = ray.origin[1];
            packet.org_z[lane] = ray.origin[2];
            packet.dir_x[lane] = ray.direction[0];
            packet.dir_y[lane] = ray.direction[1];
            packet.dir_z[lane] = ray.direction[2];
            packet.tfar[lane] = ray.target == NONE ? INFINITY : 1.0f - SHORTENED;
        }
        answers_.resize(count);
    }

    // Traces all rays so many times over. Seconds.
    double run(RTCScene scene, const std::string &form, unsigned threads, size_t passes) {
        using Part = void (Tracer::*)(RTCScene, size_t, size_t);
        const Part part = form == "single" ? &Tracer::single
                        : form == "packet8" ? &Tracer::packet8
                        : form == "stream" ? &Tracer::stream
                                           : fail_form(form);
        const size_t count = dump_.rays.size();
        const size_t chunks = (count + CHUNK - 1) / CHUNK;
        std::atomic<size_t> next{0};
        const auto work = [&] {
            // As Embree advises; it is a setting of the thread.
            _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
            _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
            for (size_t i; (i = next++) < chunks * passes;) {
                const size_t first = i % chunks * CHUNK;
                (this->*part)(scene, first, std::min(count, first + CHUNK));
            }
        };
        const auto start = std::chrono::steady_clock::now();
        std::vector<std::thread> others;
        for (unsigned i = 1; i < threads; ++i) others.emplace_back(work);
        work();
        for (auto &other : others) other.join();
        return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    }

    size_t hits() const {
        size_t hits = 0;
        for (const Answer &answer : answers_) hits += is_hit(answer);
        return hits;
    }

    // Rays whose answer is another than the one that is expected, and rays whose answer the filter puts right.
    std::pair<size_t, size_t> judge(RTCScene filtered, const std::vector<float> &expected) const {
        size_t wrong = 0, excused = 0;
        for (size_t i = 0; i < answers_.size(); ++i)
            if (!agrees(answers_[i], expected[i]))
                ++(agrees(trace_filtered(filtered, dump_.rays[i]), expected[i]) ? excused : wrong);
        return {wrong, excused};
    }

private:
    Dump dump_;
    std::vector<Packet> packets_;
    std::vector<Answer> answers_;

    [[noreturn]] static void (Tracer::*fail_form(const std::string &form))(RTCScene, size_t, size_t) {
        fail(form + ": a round is single, packet8 or stream");
    }

    static bool is_hit(const Answer &answer) { return answer.triangle != RTC_INVALID_GEOMETRY_ID; }

    bool agrees(const Answer &answer, float expected) const {
        if (is_hit(answer) != std::isfinite(expected)) return false;
        return !is_hit(answer) || dump_.shadow || std::fabs(answer.distance - expected) <= TOLERANCE * expected;
    }

    Answer trace_filtered(RTCScene filtered, const Record &record) const {
        Excluding excluding;
        rtcInitIntersectContext(&excluding.context);
        excluding.context.filter = leave_out;
        excluding.ray = &record;
        return trace_one(filtered, &excluding.context, record);
    }

    Answer trace_one(RTCScene scene, RTCIntersectContext *context, const Record &record) const {
        if (dump_.shadow) {
            RTCRay ray;
            set(ray, record);
            rtcOccluded1(scene, context, &ray);
            return blocked(ray.tfar);
        }
        RTCRayHit ray;
        set(ray.ray, record);
        ray.hit.geomID = ray.hit.primID = RTC_INVALID_GEOMETRY_ID;
        rtcIntersect1(scene, context, &ray);
        return {ray.hit.primID, ray.hit.u, ray.hit.v, ray.ray.tfar};
    }

    RTCIntersectContext context() const {
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        if (dump_.camera) context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
        return context;
    }

    static void set(RTCRay &ray, const Record &record) {
        ray.org_x = record.origin[0];
        ray.org_y = record.origin[1];
        ray.org_z = record.origin[2];
        ray.tnear = 0.0f;
        ray.dir_x = record.direction[0];
        ray.dir_y = record.direction[1];
        ray.dir_z = record.direction[2];
        ray.time = 0.0f;
        ray.tfar = record.target == NONE ? INFINITY : 1.0f - SHORTENED;
        ray.mask = 0xffffffff;
        ray.id = ray.flags = 0;
    }

    // Embree tells that something is in the way by an end of minus infinity.
    static Answer blocked(float tfar) { return {tfar < 0.0f ? 0 : RTC_INVALID_GEOMETRY_ID, 0.0f, 0.0f, tfar}; }

    void single(RTCScene scene, size_t first, size_t end) {
        RTCIntersectContext context = this->context();
        for (size_t i = first; i < end; ++i) answers_[i] = trace_one(scene, &context, dump_.rays[i]);
    }

    template <class Ray> static void set8(Ray &ray, const Packet &packet) {
        std::memcpy(ray.org_x, packet.org_x, sizeof ray.org_x);
        std::memcpy(ray.org_y, packet.org_y, sizeof ray.org_y);
        std::memcpy(ray.org_z, packet.org_z, sizeof ray.org_z);
        std::memcpy(ray.dir_x, packet.dir_x, sizeof ray.dir_x);
        std::memcpy(ray.dir_y, packet.dir_y, sizeof ray.dir_y);
        std::memcpy(ray.dir_z, packet.dir_z, sizeof ray.dir_z);
        std::memcpy(ray.tfar, packet.tfar, sizeof ray.tfar);
        std::memset(ray.tnear, 0, sizeof ray.tnear);
        std::memset(ray.time, 0, sizeof ray.time);
        std::memset(ray.mask, 0xff, sizeof ray.mask);
        std::memset(ray.id, 0, sizeof ray.id);
        std::memset(ray.flags, 0, sizeof ray.flags);
    }

    void packet8(RTCScene scene, size_t first, size_t end) {
        RTCIntersectContext context = this->context();
        for (size_t at = first; at < end; at += 8) {
            const size_t lanes = std::min<size_t>(8, end - at);
            alignas(32) int valid[8];
            for (size_t lane = 0; lane < 8; ++lane) valid[lane] = lane < lanes ? -1 : 0;
            if (dump_.shadow) {
                RTCRay8 ray;
                set8(ray, packets_[at / 8]);
                rtcOccluded8(valid, scene, &context, &ray);
                for (size_t lane = 0; lane < lanes; ++lane) answers_[at + lane] = blocked(ray.tfar[lane]);
            } else {
                RTCRayHit8 ray;
                set8(ray.ray, packets_[at / 8]);
                std::memset(ray.hit.geomID, 0xff, sizeof ray.hit.geomID);
                std::memset(ray.hit.primID, 0xff, sizeof ray.hit.primID);
                rtcIntersect8(valid, scene, &context, &ray);
                for (size_t lane = 0; lane < lanes; ++lane)
                    answers_[at + lane] = {ray.hit.primID[lane], ray.hit.u[lane], ray.hit.v[lane], ray.ray.tfar[lane]};
            }
        }
    }

    void stream(RTCScene scene, size_t first, size_t end) {
        RTCIntersectContext context = this->context();
        const size_t count = end - first;
        if (dump_.shadow) {
            alignas(64) static thread_local RTCRay rays[CHUNK];
            for (size_t i = 0; i < count; ++i) set(rays[i], dump_.rays[first + i]);
            rtcOccluded1M(scene, &context, rays, count, sizeof rays[0]);
            for (size_t i = 0; i < count; ++i) answers_[first + i] = blocked(rays[i].tfar);
        } else {
            alignas(64) static thread_local RTCRayHit rays[CHUNK];
            for (size_t i = 0; i < count; ++i) {
                set(rays[i].ray, dump_.rays[first + i]);
                rays[i].hit.geomID = rays[i].hit.primID = RTC_INVALID_GEOMETRY_ID;
            }
            rtcIntersect1M(scene, &context, rays, count, sizeof rays[0]);
            for (size_t i = 0; i < count; ++i)
                answers_[first + i] = {rays[i].hit.primID, rays[i].hit.u, rays[i].hit.v, rays[i].ray.tfar};
        }
    }
};

}  // namespace

int main(int count, char **arguments) {
    if (count < 4 || count > 5) fail("arguments are RAYS TRIANGLES DISTANCES [medium|high]");
    Dump dump = read_dump(arguments[1]);
    const std::vector<float> corners = read_npy(arguments[2]), expected = read_npy(arguments[3]);
    const size_t rays = dump.rays.size();
    if (rays == 0 || expected.size() != rays) fail(std::string(arguments[3]) + ": these are the distances of other rays");
    const bool high = count == 5 && std::string(arguments[4]) == "high";
    const RTCBuildQuality quality = high ? RTC_BUILD_QUALITY_HIGH : RTC_BUILD_QUALITY_MEDIUM;

    RTCDevice device = rtcNewDevice(nullptr);
    if (!device) fail("Embree opens no device");
    const RTCScene fast = build(device, corners, RTC_SCENE_FLAG_NONE, quality);
    const RTCScene robust = build(device, corners, RTC_SCENE_FLAG_ROBUST, quality);
    const RTCScene filtered = build(
        device, corners, RTCSceneFlags(RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION), quality);
    Tracer tracer(std::move(dump));
    std::printf("{\"version\": \"%s\", \"rays\": %zu, \"native_8_wide\": %s}\n", RTC_VERSION_STRING, rays,
                rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED) ? "true" : "false");
    std::fflush(stdout);

    for (std::string line; std::getline(std::cin, line);) {
        std::istringstream words(line);
        std::string form, scene;
        unsigned threads = 0;
        size_t passes = 0;
        words >> form >> scene >> threads >> passes;
        if (threads == 0 || passes == 0) fail(line + ": a round is FORM SCENE THREADS PASSES");
        const double seconds = tracer.run(scene == "robust" ? robust : fast, form, threads, passes);
        const auto [wrong, excused] = tracer.judge(filtered, expected);
        std::printf("{\"seconds\": %.9f, \"hits\": %zu, \"wrong\": %zu, \"excused\": %zu}\n", seconds, tracer.hits(),
                    wrong, excused);
        std::fflush(stdout);
    }
}
