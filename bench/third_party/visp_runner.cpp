// ViSP's generic model-based tracker as a program for uavbench, which starts it and speaks with it over pipes.
//
// usage: visp_runner FEATURES RANGE_PX EDGE_THRESHOLD SAMPLE_STEP_PX SCANLINE
//
// FEATURES is edge, klt or edge+klt; the other four are ViSP's parameters of the moving edges and of the visibility test.
// Its folder holds camera.toml, model.cao and init.toml; frames come on standard input, answers go to standard output
// (docs/external-trackers.md). What is not said here is as in ViSP's tutorial on markerless model-based tracking.

#include <cstdint>
#include <fstream>
#include <iostream>
#include <iterator>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <visp3/core/vpQuaternionVector.h>
#include <visp3/mbt/vpMbGenericTracker.h>

struct Settings {
    std::string features;
    int range_px;
    double edge_threshold, sample_step_px;
    bool scanline;
};

static std::string read(const std::string& path) {
    std::ifstream file(path);
    return {std::istreambuf_iterator<char>(file), {}};
}

static std::vector<double> numbers(std::string text) {
    for (char& c : text)
        if (c == '[' || c == ']' || c == ',') c = ' ';
    std::istringstream words(text);
    return {std::istream_iterator<double>(words), {}};
}

static std::string value(const std::string& toml, const std::string& key) {  // of a key at the start of a line
    std::istringstream lines("\n" + toml);
    for (std::string line; std::getline(lines, line);)
        if (line.rfind(key + " ", 0) == 0) return line.substr(line.find('=') + 1);
    return "";
}

class Lens {  // undistorts the images, which ViSP's own camera models cannot for every lens
public:
    explicit Lens(const std::string& toml) {
        const auto number = [&toml](const char* key) { return numbers(value(toml, key)).at(0); };
        camera.initPersProjWithoutDistortion(number("fx"), number("fy"), number("cx"), number("cy"));
        const std::string model = value(toml, "distortion_model");
        if (model.find("none") != std::string::npos) return;
        const cv::Matx33d K(number("fx"), 0, number("cx"), 0, number("fy"), number("cy"), 0, 0, 1);
        const std::vector<double> D = numbers(value(toml, "distortion"));
        const cv::Size size(int(number("width")), int(number("height")));
        if (model.find("radtan") != std::string::npos)
            cv::initUndistortRectifyMap(K, D, cv::noArray(), K, size, CV_32FC1, x_, y_);
        else
            cv::fisheye::initUndistortRectifyMap(K, D, cv::Matx33d::eye(), K, size, CV_32FC1, x_, y_);
    }

    void straighten(vpImage<unsigned char>& image) const {
        if (x_.empty()) return;
        cv::Mat seen(int(image.getHeight()), int(image.getWidth()), CV_8UC1, image.bitmap);
        cv::remap(seen.clone(), seen, x_, y_, cv::INTER_LINEAR);
    }

    vpCameraParameters camera;

private:
    cv::Mat x_, y_;
};

static void configure(vpMbGenericTracker& tracker, const Settings& settings) {
    int type = 0;
    if (settings.features.find("edge") != std::string::npos) type |= vpMbGenericTracker::EDGE_TRACKER;
    if (settings.features.find("klt") != std::string::npos) type |= vpMbGenericTracker::KLT_TRACKER;
    tracker.setTrackerType(type);
    if (type & vpMbGenericTracker::EDGE_TRACKER) {
        vpMe edges;
        edges.setMaskSize(5);
        edges.setMaskNumber(180);
        edges.setRange(unsigned(settings.range_px));
        edges.setThreshold(settings.edge_threshold);
        edges.setMu1(0.5);
        edges.setMu2(0.5);
        edges.setSampleStep(settings.sample_step_px);
        tracker.setMovingEdge(edges);
    }
    if (type & vpMbGenericTracker::KLT_TRACKER) {
        vpKltOpencv points;
        points.setMaxFeatures(300);
        points.setWindowSize(5);
        points.setQuality(0.015);
        points.setMinDistance(8);
        points.setHarrisFreeParameter(0.01);
        points.setBlockSize(3);
        points.setPyramidLevels(3);
        tracker.setKltOpencv(points);
        tracker.setKltMaskBorder(5);
    }
    tracker.setAngleAppear(vpMath::rad(70));
    tracker.setAngleDisappear(vpMath::rad(80));
    tracker.setNearClippingDistance(0.05);
    tracker.setFarClippingDistance(1000.0);
    tracker.setClipping(tracker.getClipping() | vpMbtPolygon::FOV_CLIPPING);
    tracker.setScanLineVisibilityTest(settings.scanline);
    tracker.setDisplayFeatures(false);
}

static vpHomogeneousMatrix initial_pose() {
    const std::string text = read("init.toml");
    const std::vector<double> m = numbers(text.substr(text.find('=') + 1));
    vpHomogeneousMatrix pose;
    for (unsigned i = 0; i < 3; ++i)
        for (unsigned j = 0; j < 4; ++j) pose[i][j] = m.at(4 * i + j);
    return pose;
}

static bool good(const vpHomogeneousMatrix& pose) {
    for (unsigned i = 0; i < 3; ++i)
        for (unsigned j = 0; j < 4; ++j)
            if (!std::isfinite(pose[i][j])) return false;
    return pose.isAnHomogeneousMatrix();
}

static bool take_frame(vpImage<unsigned char>& image, std::int64_t& stamp_ns) {
    for (std::string line; std::getline(std::cin, line);) {
        if (line.rfind("frame,", 0) != 0) continue;  // `imu,...`
        for (char& c : line)
            if (c == ',') c = ' ';
        std::istringstream words(line.substr(6));
        unsigned width = 0, height = 0, channels = 0;
        words >> stamp_ns >> width >> height >> channels;
        if (channels != 1) throw std::runtime_error("takes grey images");
        image.resize(height, width, false);
        std::cin.read(reinterpret_cast<char*>(image.bitmap), std::streamsize(width) * height);
        return bool(std::cin);
    }
    return false;
}

int main(int argc, char** argv) {
    std::ios::sync_with_stdio(false);
    std::ostream answer(std::cout.rdbuf());
    std::cout.rdbuf(std::cerr.rdbuf());  // ViSP says things on standard output, which is the harness's
    answer.precision(std::numeric_limits<double>::max_digits10);
    if (argc != 6) throw std::runtime_error("expected FEATURES RANGE_PX EDGE_THRESHOLD SAMPLE_STEP_PX SCANLINE");
    const Settings settings{argv[1], std::stoi(argv[2]), std::stod(argv[3]), std::stod(argv[4]), argv[5][0] == '1'};
    const Lens lens(read("camera.toml"));
    vpMbGenericTracker tracker;
    configure(tracker, settings);
    tracker.setCameraParameters(lens.camera);
    tracker.loadModel("model.cao");
    vpHomogeneousMatrix pose = initial_pose();
    answer << "ready" << std::endl;
    vpImage<unsigned char> image;
    std::int64_t stamp_ns = 0;
    bool following = false;
    while (take_frame(image, stamp_ns)) {
        lens.straighten(image);
        bool found = false;
        try {
            if (!following) tracker.initFromPose(image, pose);  // the first frame, and the first after a loss
            following = true;
            tracker.track(image);
            vpHomogeneousMatrix estimate;
            tracker.getPose(estimate);
            found = good(estimate);
            if (found) pose = estimate;
        } catch (const vpException& error) {
            std::cerr << error.getMessage() << std::endl;
        }
        following = following && found;
        answer << stamp_ns;
        if (found) {
            const vpQuaternionVector q(pose.getRotationMatrix());
            answer << ",ok," << pose[0][3] << ',' << pose[1][3] << ',' << pose[2][3] << ',' << q.w() << ',' << q.x()
                   << ',' << q.y() << ',' << q.z() << std::endl;
        } else {
            answer << ",lost" << std::endl;
        }
    }
}
