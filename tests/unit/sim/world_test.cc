#include "drivers/sim/world.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "tests/unit/sim/world_file.h"

namespace alhazen::sim {
namespace {

constexpr double kRadFromDeg = std::numbers::pi / 180;
constexpr Time kStart{Micros(1'000'000'000)};

Picture uniform(const DisplayTruth& display, int value) {
  return {Image::copy<std::uint8_t>(
              display.width_px, display.height_px, 8,
              std::vector<std::uint8_t>(index_of(0, display.height_px, display.width_px),
                                        static_cast<std::uint8_t>(value))),
          std::nullopt};
}

Picture stripes(const DisplayTruth& display, int period_px, int first) {
  std::vector<std::uint8_t> pixels;
  for (int y = 0; y < display.height_px; ++y)
    for (int x = 0; x < display.width_px; ++x)
      pixels.push_back((x / period_px) % 2 == first ? 255 : 0);
  return {Image::copy<std::uint8_t>(display.width_px, display.height_px, 8, pixels), std::nullopt};
}

/// The small world without noise, so that light can be compared.
std::string quiet() {
  return replaced(
      text_of(shipped_world("small")), "bits = 8",
      "bits = 16\nshot_noise = false\nread_noise_e = 0.0\nsaturation_exposure_ms = 20.0");
}

const Region kAll{0, 0, 160, 160};

std::vector<double> light_of(const Image& image) {
  std::vector<double> out;
  for (const std::uint16_t value : image.mono16()) out.push_back(value - 0.02 * 65535);
  return out;
}

double sum_of(const Image& image) {
  double sum = 0;
  for (const double value : light_of(image)) sum += value;
  return sum;
}

TEST(World, PictureAppearsWithLatencyAtARefreshAndFadesIn) {
  const auto world = make_world(quiet());
  const DisplayTruth& display = world->scene().displays[0];
  const Time steady = world->show(0, uniform(display, 255), kStart);
  EXPECT_GE(steady - kStart, display.latency + display.response);
  EXPECT_LE(steady - kStart, display.latency + display.response + Micros(16'667));
  const Time begin = steady - display.response;
  const auto at = [&](Time when, Micros duration) {
    return sum_of(world->expose({0, when, duration, 0, kAll}));
  };
  const double dark = at(kStart, Micros(1000)),
               half = at(begin + display.response / 2 - Micros(500), Micros(1000)),
               full = at(steady, Micros(1000));
  EXPECT_LT(dark, 0.01 * full);
  EXPECT_NEAR((half - dark) / (full - dark), 0.5, 0.01);
  // Whoever exposes over the change records the mixture by time.
  const double over =
      at(steady - display.response - Micros(6000), Micros(6000) + display.response + Micros(6000));
  EXPECT_NEAR(over / (12'000 + static_cast<double>(display.response.count())), full / 1000 / 2,
              0.02 * full / 1000);
}

TEST(World, NotWaitingForTheDisplayRecordsTheOldPicture) {
  const auto world = make_world(quiet());
  const DisplayTruth& display = world->scene().displays[0];
  const Time steady = world->show(0, stripes(display, 16, 0), kStart);
  const Image right = world->expose({0, steady, Micros(9000), 0, kAll});
  (void)world->show(0, stripes(display, 16, 1), steady + Micros(9000));
  const Image hasty = world->expose({0, steady + Micros(9000), Micros(9000), 0, kAll});
  EXPECT_TRUE(std::ranges::equal(right.mono16(), hasty.mono16()));
}

TEST(World, ARoundObjectLooksTheSameWhileItTurns) {
  const auto world = make_world(quiet());
  const DisplayTruth& display = world->scene().displays[0];
  const Time steady = world->show(0, stripes(display, 4, 0), kStart);
  const Image before = world->expose({1, steady, Micros(9000), 0, kAll});
  const Time rest = world->turn(30 * kRadFromDeg, steady + Micros(9000));
  EXPECT_GT(rest - steady, Micros(300'000));
  const Image moving = world->expose({1, steady + Micros(200'000), Micros(9000), 0, kAll});
  const Image after = world->expose({1, rest, Micros(9000), 0, kAll});
  const double same = sum_of(before);
  EXPECT_NEAR(sum_of(after) / same, 1, 1e-3);
  EXPECT_NEAR(sum_of(moving) / same, 1, 1e-3);
  EXPECT_FALSE(world->table_at_rest(rest - Micros(1)));
  EXPECT_TRUE(world->table_at_rest(rest));
}

TEST(World, TurningObjectThatIsNotRoundSmears) {
  const std::string block =
      replaced(quiet(), "form = \"sphere\"\nradius_mm = 12.0",
               "form = \"pits\"\nblock_mm = [24.0, 12.0, 10.0]\npit_count = 2\npit_radius_mm = "
               "5.0\npit_depth_max_mm = 3.0\nmin_triangles = 4");
  const auto world = make_world(block);
  const DisplayTruth& display = world->scene().displays[1];
  const Time steady = world->show(1, stripes(display, 8, 0), kStart);
  const Time rest = world->turn(20 * kRadFromDeg, steady);
  const Time middle = steady + (rest - steady) / 2;
  const std::vector<double> moving = light_of(world->expose({2, middle, Micros(9000), 0, kAll}));
  const std::vector<double> resting = light_of(world->expose({2, rest, Micros(9000), 0, kAll}));
  const std::vector<double> again =
      light_of(world->expose({2, rest + Micros(50'000), Micros(9000), 0, kAll}));
  double changed = 0, scale = 0;
  for (std::size_t i = 0; i < moving.size(); ++i) {
    changed += std::abs(moving[i] - resting[i]);
    scale += std::abs(resting[i]);
  }
  EXPECT_GT(changed, 0.1 * scale);
  EXPECT_EQ(resting, again);
}

TEST(World, RepeatsBitByBitAndDiffersBySeed) {
  const std::string text = text_of(shipped_world("small"));
  std::vector<std::vector<std::uint8_t>> frames;
  for (const char* seed : {"seed = 1", "seed = 1", "seed = 2"}) {
    const auto world = make_world(replaced(text, "seed = 1", seed));
    const DisplayTruth& display = world->scene().displays[0];
    Time now = world->show(0, stripes(display, 8, 0), kStart);
    // One world took another way here: the past must not matter.
    if (frames.empty()) {
      now = world->show(0, uniform(display, 255), now + Micros(77'000));
      (void)world->expose({0, now, Micros(9000), 0, kAll});
      now = world->turn(-1, now + Micros(9000));
      now = world->turn(-2 * kRadFromDeg - 0.001, now);
      now = world->show(0, stripes(display, 8, 0), now);
    }
    now = world->turn(0.5, now);
    const Image image = world->expose({0, now, Micros(9000), 0, kAll}),
                retaken = world->expose({0, now + Micros(123'456), Micros(9000), 0, kAll});
    EXPECT_TRUE(std::ranges::equal(image.mono8(), retaken.mono8()));
    frames.emplace_back(image.mono8().begin(), image.mono8().end());
  }
  EXPECT_EQ(frames[0], frames[1]);
  EXPECT_NE(frames[0], frames[2]);
}

TEST(World, RegionIsACutOfTheWholePicture) {
  const auto world = make_world(text_of(shipped_world("small")));
  const Time now = world->show(0, stripes(world->scene().displays[0], 8, 0), kStart);
  const Image whole = world->expose({0, now, Micros(9000), 0, kAll});
  const Region region{32, 32, 77, 64};
  const Image part = world->expose({0, now, Micros(9000), 0, region});
  int different = 0;
  for (int y = 0; y < region.height; ++y)
    for (int x = 0; x < region.width; ++x)
      different += part.mono8()[index_of(x, y, region.width)] !=
                           whole.mono8()[index_of(region.x + x, region.y + y, 160)]
                       ? 1
                       : 0;
  EXPECT_LE(different, 5);  // where a rounding of the light falls the other way
}

TEST(World, ForgetsNothingThatAnExposureStillNeeds) {
  const auto world = make_world(quiet());
  const DisplayTruth& display = world->scene().displays[0];
  const Time steady = world->show(0, uniform(display, 255), kStart);
  const double expected = sum_of(world->expose({0, steady, Micros(9000), 0, kAll}));
  world->begin_exposure(0, steady);
  Time now = steady + Micros(9000);
  for (int i = 0; i < 20; ++i) now = world->show(0, uniform(display, 0), now);
  EXPECT_EQ(sum_of(world->expose({0, steady, Micros(9000), 0, kAll})), expected);
}

TEST(World, KeepsTransportWithinItsMemory) {
  const auto world =
      make_world(replaced(text_of(shipped_world("small")), "memory_mb = 64", "memory_mb = 1"));
  Time now = kStart;
  for (int stop = 0; stop < 8; ++stop) {
    now = world->turn(0.01 * stop, now);
    for (const std::size_t camera : {0U, 1U})
      (void)world->transport(camera, world->table_rad(now), kAll);
  }
  EXPECT_LE(world->figures().cached_bytes, std::size_t{1} << 20);
  const auto traces = world->figures().traces;
  (void)world->transport(1, world->table_rad(now), kAll);
  EXPECT_EQ(world->figures().traces, traces);
}

TEST(TableMotion, MovesWithSpeedAndAcceleration) {
  TableTruth truth;
  truth.speed_rad_s = 0.5;
  truth.acceleration_rad_s2 = 1;
  truth.encoder_step_rad = 1e-6;
  TableMotion table(truth, 1);
  const Time rest = table.turn(1, kStart);
  EXPECT_NEAR(static_cast<double>((rest - kStart).count()) * 1e-6, 1 / 0.5 + 0.5, 1e-5);
  EXPECT_NEAR(table.angle_rad(kStart + Micros(500'000)), 0.125, 1e-6);
  EXPECT_NEAR(table.angle_rad(kStart + Micros(1'250'000)), 0.5, 1e-6);
  EXPECT_EQ(table.angle_rad(rest), 1);
  EXPECT_TRUE(table.rests(rest, rest + Micros(10)));
  EXPECT_FALSE(table.rests(rest - Micros(10), rest + Micros(10)));
  double last = 0;
  for (Time t = kStart; t <= rest; t += Micros(1000)) {
    EXPECT_GE(table.angle_rad(t), last);
    EXPECT_LE(table.angle_rad(t) - last, 0.000501);
    last = table.angle_rad(t);
  }
  // Too short a way to reach full speed.
  EXPECT_NEAR(static_cast<double>((table.turn(1.01, rest) - rest).count()) * 1e-6,
              2 * std::sqrt(0.01), 1e-5);
}

TEST(TableMotion, LagsByItsBacklashWhenItComesBack) {
  TableTruth truth;
  truth.speed_rad_s = truth.acceleration_rad_s2 = 1;
  truth.backlash_rad = 0.01;
  truth.position_error_rad = 0.002;
  truth.encoder_step_rad = 1e-9;
  TableMotion table(truth, 1);
  const Time up = table.turn(0.5, kStart);
  const double from_below = table.angle_rad(up);
  EXPECT_NE(from_below, 0.5);
  EXPECT_NEAR(from_below, 0.5, 0.002);
  const Time beyond = table.turn(0.8, up), back = table.turn(0.5, beyond);
  EXPECT_NEAR(table.angle_rad(back) - from_below, 0.01, 1e-12);
  // Less than the backlash does not move the table at all.
  const Time little = table.turn(0.495, back);
  EXPECT_NEAR(table.angle_rad(little), table.angle_rad(back), 0.006);
  const Time below = table.turn(0.3, little), again = table.turn(0.5, below);
  EXPECT_EQ(table.angle_rad(again), from_below);
  EXPECT_NEAR(table.encoder_rad(again), from_below, 1e-9);
}

TEST(TableMotion, StaysWhereItWasHalted) {
  TableTruth truth;
  truth.speed_rad_s = truth.acceleration_rad_s2 = 1;
  truth.encoder_step_rad = 1e-9;
  TableMotion table(truth, 1);
  (void)table.turn(2, kStart);
  const Time halt = kStart + Micros(1'300'000);
  const double there = table.angle_rad(halt);
  table.halt(halt);
  EXPECT_EQ(table.angle_rad(halt + Micros(9'000'000)), there);
  EXPECT_TRUE(table.at_rest(halt));
  EXPECT_FALSE(table.rests(kStart, halt));
  EXPECT_TRUE(table.rests(halt, halt + Micros(5)));
}

TEST(Faults, StrikeTheCallTheyAreScriptedFor) {
  std::vector<FaultRule> rules(2);
  rules[0] = {"c0", "wait_frame", 2, FaultKind::corrupt, true, Micros(0)};
  rules[1] = {"turntable", "", 3, FaultKind::timeout, false, Micros(0)};
  Faults faults(rules);
  EXPECT_FALSE(faults.next("c0", "trigger"));
  EXPECT_FALSE(faults.next("c0", "wait_frame"));
  EXPECT_FALSE(faults.next("c1", "wait_frame"));
  EXPECT_FALSE(faults.next("c0", "trigger"));
  EXPECT_TRUE(faults.next("c0", "wait_frame"));
  EXPECT_FALSE(faults.next("c0", "wait_frame"));
  EXPECT_FALSE(faults.next("turntable", "home"));
  EXPECT_FALSE(faults.next("turntable", "move_to"));
  for (int i = 0; i < 5; ++i) EXPECT_TRUE(faults.next("turntable", "move_to"));
}

}  // namespace
}  // namespace alhazen::sim
