#include "diagnosis/model/plant_model.h"

#include <gtest/gtest.h>

#include "diagnosis/model/plant_file.h"
#include "tests/diagnosis/hou_plant.h"

namespace faultline {
namespace {

TEST(PlantDigest, IgnoresCommentsAndLayout) {
  std::string text = hou_plant_text();
  text.replace(text.find("A = [[1, 1, 1],"), 15, "A = [ # the dynamics\n  [1.0, 1e0, 1],");
  EXPECT_EQ(plant_digest(parse_plant(text, "other.toml")), plant_digest(hou_plant()));
}

TEST(PlantDigest, ChangesWithEveryPartOfTheModel) {
  const std::string digest = plant_digest(hou_plant());
  EXPECT_EQ(digest.size(), 36u);
  EXPECT_EQ(digest[14], '5');  // a version 5 UUID
  const auto differs = [&](auto change) {
    PlantModel plant = hou_plant();
    change(plant);
    return plant_digest(plant) != digest;
  };
  EXPECT_TRUE(differs([](PlantModel& plant) { plant.A(0, 0) += 1e-15; }));
  EXPECT_TRUE(differs([](PlantModel& plant) { plant.time = TimeDomain::kDiscrete; }));
  EXPECT_TRUE(differs([](PlantModel& plant) { plant.input_names[0].push_back('v'); }));
  EXPECT_TRUE(differs([](PlantModel& plant) { plant.faults[0].size = 2.0; }));
  EXPECT_TRUE(differs([](PlantModel& plant) { plant.faults.pop_back(); }));
  EXPECT_TRUE(differs([](PlantModel& plant) { plant.y_operating[2] = 1.0; }));
  EXPECT_TRUE(differs([](PlantModel& plant) { plant.output_range[0] = 1.0; }));
}

TEST(PlantDigest, StaysWhatItWas) {
  EXPECT_EQ(plant_digest(hou_plant()), "6ba1d91f-4ed3-53db-9891-4e4e62649e8b");
}

}  // namespace
}  // namespace faultline
