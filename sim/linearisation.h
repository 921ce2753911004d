#pragma once

#include <complex>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "diagnosis/model/plant_model.h"
#include "sim/equation_plant.h"
#include "sim/plant_table.h"

namespace faultline {

/// There is no equilibrium near, or the equations are not finite or throw there: the message says
/// which.
class NoLinearisation : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

struct LinearisationOptions {
  PlantParameters parameters;  ///< values other than the table's
  /// States and inputs that keep the value given here; the others move as little as they must.
  std::map<std::string, double, std::less<>> hold;
};

/// A plant about an equilibrium, and what is known of how well.
struct Linearisation {
  PlantModel model;
  /// Largest estimated error of an entry of a Jacobian, in sizes of its row per size of its column
  /// (and second).
  double largest_error = 0.0;
  std::string worst_entry;                        ///< where: "d(link_speed)/d(link_angle)"
  std::vector<std::complex<double>> eigenvalues;  ///< of A
  /// Faults and disturbances that are in no equation here, and hence not in the model.
  std::vector<std::string> unseen;
};

/// The equilibrium f(x, u, p, 0) = 0 nearest to the nominal point, distances in sizes of states and
/// inputs, and the plant there: A, B, C, D by central differences, extrapolated to step zero
/// (Ridders, Advances in Engineering Software 4, 1982). Every actuator, sensor and every parameter
/// with a size is a fault; a disturbance that acts on outputs alone becomes a noise source.
/// @throws NoLinearisation; std::invalid_argument an unknown name (the nearest), two faults of one
///   name.
[[nodiscard]] Linearisation linearise(const faultline_plant_table& table,
                                      const LinearisationOptions& options = {});

}  // namespace faultline
