#include "tests/diagnosis/hou_plant.h"

#include <fmt/format.h>

#include "diagnosis/design/design_bank.h"
#include "diagnosis/model/plant_file.h"

namespace faultline {

std::string hou_plant_text() {
  return R"(# Hou 2015
schema = 1
name   = "hou2015"
time   = "continuous"
[states]
names = ["x1", "x2", "x3"]
[inputs]
names = ["u1", "u2", "u3", "u4"]
[outputs]
names = ["y1", "y2", "y3"]
[dynamics]
A = [[1, 1, 1], [0, -1, 2], [2, 0, -4]]
B = [[1, 0, 1, 1], [0, 1, 1, 0], [0, 1, 0, 1]]
C = [[0, 1, 0], [0, 0, 1], [1, 0, 2]]
[faults]
actuators = "all"
)";
}

std::string hou_request_text(bool normalise, int dwell) {
  return fmt::format(R"(schema = 1
name   = "pairs"
plant  = "plant.toml"
method = "geometric"
concurrent    = 2
poles         = [-10.0]
sample_time_s = 0.01
normalise     = {}
[decision]
threshold = 0.05
dwell     = {}
)",
                     normalise, dwell);
}

PlantModel hou_plant() { return parse_plant(hou_plant_text(), "plant.toml"); }

BankRequest hou_request(bool normalise, int dwell) {
  return parse_bank_request(hou_request_text(normalise, dwell), "bank.toml");
}

Bank hou_bank(bool normalise, int dwell) {
  return design_bank(hou_plant(), hou_request(normalise, dwell)).bank;
}

}  // namespace faultline
