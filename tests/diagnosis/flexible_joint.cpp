#include "tests/diagnosis/flexible_joint.h"

#include "diagnosis/model/plant_file.h"

namespace faultline {

PlantModel flexible_joint() { return read_plant(FAULTLINE_EXAMPLES_DIR "/ma2024/plant.toml"); }

PlantModel flexible_joint_euler() {
  return read_plant(FAULTLINE_EXAMPLES_DIR "/ma2024/plant_euler.toml");
}

BankRequest joint_request(const std::string& uio) {
  return parse_bank_request(R"(schema = 1
name = "joint"
plant = "plant.toml"
method = "uio"
sample_time_s = 0.01
[decision]
dwell = 1
settle = 1
[uio]
)" + uio,
                            "bank.toml");
}

}  // namespace faultline
