#include "tools/bench/scenario_tables.h"

namespace faultline {

ControllerSpec read_controller(TomlTable table) {
  ControllerSpec spec;
  const std::string kind = table.choice("kind", {"lqr", "gain", "none"});
  if (kind == "lqr") {
    spec.kind = ControllerKind::kLqr;
    spec.Q = table.optional_matrix("Q", -1, -1);
    spec.R = table.optional_matrix("R", -1, -1);
  } else if (kind == "gain") {
    spec.kind = ControllerKind::kGain;
    spec.K = table.matrix("K", -1, -1);
  }
  spec.feedforward = table.optional_vector("feedforward", -1);
  spec.amplitude = table.optional_vector("amplitude", -1);
  if (spec.amplitude) spec.frequency_Hz = table.vector("frequency_Hz", spec.amplitude->size());
  return spec;
}

}  // namespace faultline
