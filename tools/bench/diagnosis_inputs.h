#pragma once

#include <string>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "drivers/signal/signal_map.h"
#include "tools/lcm/run_parts.h"

namespace faultline {

/// Everything the diagnosis needs, read, checked and fitted together.
struct DiagnosisInputs {
  std::string name;  ///< of the scenario, or of the bank where there is none
  Bank bank;
  SignalMap map;
  bool is_initial_state_known = false;    ///< the bank need not forget its start
  std::vector<RunPart> parts;             ///< what it was made from
  std::vector<std::string> dbc_warnings;  ///< "file:line:column: ..."
};

}  // namespace faultline
