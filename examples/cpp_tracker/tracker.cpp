// A tracker for uavbench in C++17, without any library: where to start from.
//
// Its folder holds what a tracker may know: camera.toml, model.obj, edges.csv, init.toml. Frames come on standard input as a
// line `frame,STAMP_NS,WIDTH,HEIGHT,CHANNELS` and then the rows of pixels; one line of answer for each goes to standard
// output. This one repeats the initial pose, and says `lost` when the frame is blank: put your own method into track().

#include <array>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <iostream>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

using Matrix = std::array<double, 16>;  // row-major 4x4

static std::string read(const std::string& path) {
    std::ifstream file(path);
    return {std::istreambuf_iterator<char>(file), {}};
}

static Matrix initial_pose() {  // cam_from_model = [[..], [..], [..], [..]]: the sixteen numbers after the `=`
    std::string text = read("init.toml");
    text.erase(0, text.find('=') + 1);
    for (char& c : text)
        if (c == '[' || c == ']' || c == ',') c = ' ';
    std::istringstream numbers(text);
    Matrix pose{};
    for (double& value : pose) numbers >> value;
    return pose;
}

static std::array<double, 4> quaternion(const Matrix& m) {  // w first (Shepperd 1978)
    const double m00 = m[0], m11 = m[5], m22 = m[10];
    std::array<double, 4> q = {1 + m00 + m11 + m22, m[9] - m[6], m[2] - m[8], m[4] - m[1]};
    if (m00 > m11 && m00 > m22 && m00 > m00 + m11 + m22)
        q = {m[9] - m[6], 1 + m00 - m11 - m22, m[1] + m[4], m[2] + m[8]};
    else if (m11 > m22 && m11 > m00 + m11 + m22)
        q = {m[2] - m[8], m[1] + m[4], 1 - m00 + m11 - m22, m[6] + m[9]};
    else if (m22 > m00 + m11 + m22)
        q = {m[4] - m[1], m[2] + m[8], m[6] + m[9], 1 - m00 - m11 + m22};
    const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (double& value : q) value /= norm;
    return q;
}

class Tracker {
public:
    explicit Tracker(const Matrix& cam_from_model) : pose_(cam_from_model) {}

    // True when there is an estimate; pixels are grey or BGR, row by row.
    bool track(const std::vector<std::uint8_t>& pixels, int width, int height, int channels, Matrix& cam_from_model) {
        double sum = 0, squares = 0;
        const std::size_t count = static_cast<std::size_t>(width) * height * channels;
        for (std::size_t i = 0; i < count; ++i) sum += pixels[i], squares += double(pixels[i]) * pixels[i];
        const double mean = sum / count;
        cam_from_model = pose_;
        return squares / count - mean * mean > 1.0;
    }

private:
    Matrix pose_;
};

int main() {
    std::ios::sync_with_stdio(false);
    Tracker tracker(initial_pose());
    std::cout.precision(15);
    std::cout << "ready" << std::endl;
    std::string line;
    std::vector<std::uint8_t> pixels;
    while (std::getline(std::cin, line)) {
        for (char& c : line)
            if (c == ',') c = ' ';
        std::istringstream words(line);
        std::string kind;
        std::int64_t stamp_ns = 0;
        int width = 0, height = 0, channels = 0;
        words >> kind >> stamp_ns >> width >> height >> channels;
        if (kind != "frame") continue;  // `imu,...`
        pixels.resize(static_cast<std::size_t>(width) * height * channels);
        std::cin.read(reinterpret_cast<char*>(pixels.data()), static_cast<std::streamsize>(pixels.size()));
        Matrix pose;
        if (tracker.track(pixels, width, height, channels, pose)) {
            std::cout << stamp_ns << ",ok," << pose[3] << ',' << pose[7] << ',' << pose[11];
            for (double value : quaternion(pose)) std::cout << ',' << value;
            std::cout << std::endl;  // std::endl flushes: the harness waits for this line
        } else {
            std::cout << stamp_ns << ",lost" << std::endl;
        }
    }
}
