#include "tests/sim/test_plants.h"

#include "drivers/dbc/dbc_parser.h"
#include "sim/fault_schedule.h"

namespace faultline {

PlantModel double_integrator() {
  PlantModel plant;
  plant.name = "double integrator";
  plant.state_names = {"position", "speed"};
  plant.input_names = {"force"};
  plant.output_names = {"y1", "y2"};
  plant.A = (Eigen::MatrixXd(2, 2) << 0, 1, 0, 0).finished();
  plant.B = (Eigen::MatrixXd(2, 1) << 0, 1).finished();
  plant.C = Eigen::MatrixXd::Identity(2, 2);
  plant.D = Eigen::MatrixXd::Zero(2, 1);
  plant.x_operating = (Eigen::VectorXd(2) << 1, 2).finished();
  plant.u_operating = (Eigen::VectorXd(1) << 3).finished();
  plant.y_operating = (Eigen::VectorXd(2) << 1, 2).finished();
  plant.faults = {{.name = "force",
                   .kind = FaultKind::kActuator,
                   .state = plant.B.col(0),
                   .output = Eigen::VectorXd::Zero(2)},
                  {.name = "leak",
                   .kind = FaultKind::kComponent,
                   .state = (Eigen::VectorXd(2) << 1, 0).finished(),
                   .output = (Eigen::VectorXd(2) << 0, 0.5).finished()}};
  return plant;
}

PlantModel scalar_plant(double a, double gain, const NonlinearFunction& function) {
  const Eigen::VectorXd one = Eigen::VectorXd::Ones(1);
  PlantModel plant;
  plant.name = "scalar";
  plant.state_names = {"x"};
  plant.input_names = {"u"};
  plant.output_names = {"y"};
  plant.A = Eigen::MatrixXd::Constant(1, 1, a);
  plant.B = Eigen::MatrixXd::Ones(1, 1);
  plant.C = Eigen::MatrixXd::Ones(1, 1);
  plant.D = Eigen::MatrixXd::Constant(1, 1, 0.25);
  plant.faults = {{.name = "leak",
                   .kind = FaultKind::kComponent,
                   .state = one,
                   .output = Eigen::VectorXd::Zero(1)}};
  plant.disturbances = {{.name = "wind", .state = 0.5 * one, .output = 2.0 * one, .bound = 0.1}};
  plant.noises = {{.name = "hum", .output = 3.0 * one, .bound = 0.2, .sigma = {}},
                  {.name = "hiss", .output = 4.0 * one, .bound = {}, .sigma = 0.1}};
  const SlopeBounds slopes = slope_bounds(function);
  plant.nonlinearities = {{.function = function,
                           .gain = gain,
                           .E_o = one,
                           .E_i = one,
                           .slope_min = slopes.min,
                           .slope_max = slopes.max}};
  plant.x_operating = plant.u_operating = plant.y_operating = Eigen::VectorXd::Zero(1);
  return plant;
}

std::vector<double> no_faults(const PlantModel& plant) {
  return std::vector<double>(fault_targets(plant).components.size(), 0.0);
}

SignalMap double_integrator_map() {
  const DbcDatabase dbc = parse_dbc(R"(VERSION ""
BS_:
BU_: P C
BO_ 1 Sync: 8 P
 SG_ K : 0|32@1+ (1,0) [0|0] "" C
 SG_ Ck : 32|32@1+ (1,0) [0|0] "" C
BO_ 2 Position: 5 P
 SG_ y1 : 0|32@1- (0.0009765625,0) [0|0] "" C
 SG_ PositionCycle : 32|8@1+ (1,0) [0|0] "" C
BO_ 3 Speed: 5 P
 SG_ y2 : 0|32@1- (0.0009765625,0) [0|0] "" C
 SG_ SpeedCycle : 32|8@1+ (1,0) [0|0] "" C
BO_ 4 Command: 5 C
 SG_ force : 0|32@1- (0.0009765625,0) [0|0] "" P
 SG_ CommandCycle : 32|8@1+ (1,0) [0|0] "" P
BA_DEF_ SG_ "FaultlineRole" ENUM "none","sync","cycle","command_cycle";
BA_DEF_DEF_ "FaultlineRole" "none";
BA_ "FaultlineRole" SG_ 1 K 1;
BA_ "FaultlineRole" SG_ 1 Ck 3;
BA_ "FaultlineRole" SG_ 2 PositionCycle 2;
BA_ "FaultlineRole" SG_ 3 SpeedCycle 2;
BA_ "FaultlineRole" SG_ 4 CommandCycle 2;
)",
                                    "double_integrator.dbc");
  return make_signal_map(dbc, {"y1", "y2"}, {"force"});
}

SignalMap protected_double_integrator_map() {
  const DbcDatabase dbc = parse_dbc(R"(VERSION ""
BS_:
BU_: P C
BO_ 1 Sync: 12 P
 SG_ K : 0|32@1+ (1,0) [0|0] "" C
 SG_ Ck : 32|32@1+ (1,0) [0|0] "" C
 SG_ SyncCrc : 64|8@1+ (1,0) [0|0] "" C
 SG_ SyncAlive : 72|4@1+ (1,0) [0|0] "" C
BO_ 2 Position: 8 P
 SG_ y1 : 0|32@1- (0.0009765625,0) [0|0] "" C
 SG_ PositionCycle : 32|8@1+ (1,0) [0|0] "" C
 SG_ PositionCrc : 40|16@1+ (1,0) [0|0] "" C
 SG_ PositionAlive : 56|8@1+ (1,0) [0|0] "" C
BO_ 3 Speed: 7 P
 SG_ y2 : 0|32@1- (0.0009765625,0) [0|0] "" C
 SG_ SpeedCycle : 32|8@1+ (1,0) [0|0] "" C
 SG_ SpeedCrc : 40|8@1+ (1,0) [0|0] "" C
 SG_ SpeedAlive : 48|4@1+ (1,0) [0|0] "" C
BO_ 4 Command: 7 C
 SG_ force : 0|32@1- (0.0009765625,0) [0|0] "" P
 SG_ CommandCycle : 32|8@1+ (1,0) [0|0] "" P
 SG_ CommandCrc : 40|8@1+ (1,0) [0|0] "" P
 SG_ CommandAlive : 48|4@1+ (1,0) [0|0] "" P
BA_DEF_ SG_ "FaultlineRole" ENUM "none","sync","cycle","command_cycle","alive","crc";
BA_DEF_ BO_ "FaultlineProtection" STRING ;
BA_DEF_ BO_ "FaultlineDataId" INT 0 65535;
BA_DEF_DEF_ "FaultlineRole" "none";
BA_ "FaultlineProtection" BO_ 1 "E2E_P01A";
BA_ "FaultlineProtection" BO_ 2 "E2E_P05";
BA_ "FaultlineProtection" BO_ 3 "E2E_P01A";
BA_ "FaultlineProtection" BO_ 4 "J1850";
BA_ "FaultlineDataId" BO_ 1 1;
BA_ "FaultlineDataId" BO_ 2 2;
BA_ "FaultlineDataId" BO_ 3 3;
BA_ "FaultlineRole" SG_ 1 K 1;
BA_ "FaultlineRole" SG_ 1 Ck 3;
BA_ "FaultlineRole" SG_ 1 SyncCrc 5;
BA_ "FaultlineRole" SG_ 1 SyncAlive 4;
BA_ "FaultlineRole" SG_ 2 PositionCycle 2;
BA_ "FaultlineRole" SG_ 2 PositionCrc 5;
BA_ "FaultlineRole" SG_ 2 PositionAlive 4;
BA_ "FaultlineRole" SG_ 3 SpeedCycle 2;
BA_ "FaultlineRole" SG_ 3 SpeedCrc 5;
BA_ "FaultlineRole" SG_ 3 SpeedAlive 4;
BA_ "FaultlineRole" SG_ 4 CommandCycle 2;
BA_ "FaultlineRole" SG_ 4 CommandCrc 5;
BA_ "FaultlineRole" SG_ 4 CommandAlive 4;
)",
                                    "protected.dbc");
  return make_signal_map(dbc, {"y1", "y2"}, {"force"});
}

}  // namespace faultline
