#include "sim/linearisation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <functional>
#include <initializer_list>
#include <limits>
#include <span>
#include <utility>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Signals = std::span<const faultline_plant_signal>;

// The largest step of a difference, in sizes; a power of two near it leaves no rounding in x + h.
constexpr double kLargestStep = 0.1;
// Halvings of it: down to 5e-5 of a size, where rounding takes over from what is neglected.
constexpr int kLevels = 12;
constexpr int kMostIterations = 100;
// At rest: a state that would need so many seconds to move by its size is going nowhere.
constexpr double kRest_per_s = 1e-9;
// Below this nothing is left to be improved: rounding of f in units of sizes.
constexpr double kRounding = 1e-14;
// An entry that moves its row less than this part of what the row's largest does, by sizes, is what
// rounding leaves of zero: a row is summed to 1e-16 of its largest terms, and differences over
// steps of 5e-5 sizes make 1e-12 of that.
constexpr double kNegligible = 1e-12;
// Singular directions of the scaled Jacobian below this part of the largest are none.
constexpr double kRankTolerance = 1e-10;

VectorXd numbers(Signals signals, double faultline_plant_signal::*member) {
  VectorXd values(std::ssize(signals));
  for (Index i = 0; i < values.size(); ++i)
    values[i] = signals[static_cast<std::size_t>(i)].*member;
  return values;
}

std::vector<std::string> names_of(Signals signals) {
  std::vector<std::string> names;
  for (const faultline_plant_signal& signal : signals) names.emplace_back(signal.name);
  return names;
}

struct Jacobian {
  MatrixXd value, error;  // one row per function, one column per variable
};

/// A column of a Jacobian: of `f` at s = 0, by Ridders' extrapolation, entry by entry.
void differentiate(const std::function<VectorXd(double)>& f, double largest_step,
                   Jacobian& jacobian, Index column) {
  const Index rows = jacobian.value.rows();
  VectorXd best_error = VectorXd::Constant(rows, std::numeric_limits<double>::infinity());
  VectorXd best = VectorXd::Constant(rows, std::numeric_limits<double>::quiet_NaN());
  std::array<VectorXd, kLevels> previous, current;
  for (int level = 0; level < kLevels; ++level) {
    const double h = std::ldexp(largest_step, -level);
    current[0] = (f(h) - f(-h)) / (2.0 * h);
    if (level == 0) best = current[0];
    double factor = 1.0;
    for (int j = 1; j <= level; ++j) {
      const auto at = static_cast<std::size_t>(j);
      factor *= 4.0;
      current[at] = (factor * current[at - 1] - previous[at - 1]) / (factor - 1.0);
      const VectorXd error = (current[at] - current[at - 1])
                                 .cwiseAbs()
                                 .cwiseMax((current[at] - previous[at - 1]).cwiseAbs());
      for (Index i = 0; i < rows; ++i) {
        if (!(error[i] < best_error[i]) || !std::isfinite(current[at][i])) continue;
        best_error[i] = error[i];
        best[i] = current[at][i];
      }
    }
    previous = current;
  }
  jacobian.value.col(column) = best;
  jacobian.error.col(column) = best_error;
}

/// A plant's functions at a point that moves.
class Equations {
 public:
  Equations(const faultline_plant_table& table, const PlantParameters& chosen)
      : table_(table),
        states({table.states, table.state_count}),
        inputs({table.inputs, table.input_count}),
        outputs({table.outputs, table.output_count}),
        parameters({table.parameters, table.parameter_count}),
        disturbances({table.disturbances, table.disturbance_count}),
        x(numbers(states, &faultline_plant_signal::nominal)),
        u(numbers(inputs, &faultline_plant_signal::nominal)),
        d(VectorXd::Zero(std::ssize(disturbances))) {
    const std::vector<double> values = parameter_values(table, chosen);
    p = Eigen::Map<const VectorXd>(values.data(), std::ssize(values));
  }

  [[nodiscard]] VectorXd f() const {
    VectorXd dx = VectorXd::Zero(x.size());
    call("derivative",
         [&] { table_.derivative(x.data(), u.data(), p.data(), d.data(), dx.data()); });
    return dx;
  }
  [[nodiscard]] VectorXd h() const {
    VectorXd y = VectorXd::Zero(std::ssize(outputs));
    call("measure", [&] { table_.measure(x.data(), u.data(), p.data(), d.data(), y.data()); });
    return y;
  }
  /// f and h, one below the other, by `variables`, which is x, u, p or d of this.
  [[nodiscard]] Jacobian jacobian(VectorXd& variables, Signals signals) {
    const Index n = x.size();
    const Index q = std::ssize(outputs);
    Jacobian result{MatrixXd::Zero(n + q, variables.size()),
                    MatrixXd::Zero(n + q, variables.size())};
    for (Index j = 0; j < variables.size(); ++j) {
      const double there = variables[j];
      const double size = signals[static_cast<std::size_t>(j)].size;
      const double step =
          std::exp2(std::round(std::log2(kLargestStep * (size > 0.0 ? size : 1.0))));
      differentiate(
          [&](double s) {
            variables[j] = there + s;
            VectorXd both(n + q);
            both << f(), h();
            return both;
          },
          step, result, j);
      variables[j] = there;
      check_finite(result.value.col(j), signals[static_cast<std::size_t>(j)].name);
    }
    return result;
  }
  [[nodiscard]] std::string row_name(Index row) const {
    return row < x.size() ? states[static_cast<std::size_t>(row)].name
                          : outputs[static_cast<std::size_t>(row - x.size())].name;
  }
  void check_finite(const VectorXd& rows, const char* by) const {
    for (Index i = 0; i < rows.size(); ++i) {
      if (std::isfinite(rows[i])) continue;
      const char* what = i < x.size() ? "the derivative of " : "";
      throw NoLinearisation(by == nullptr
                                ? fmt::format("{}{} is not finite there", what, row_name(i))
                                : fmt::format("the change of {}{} with {} is not finite there",
                                              what, row_name(i), by));
    }
  }

 private:
  template <class Function>
  static void call(const char* name, const Function& function) {
    std::string what = "an exception that is no std::exception";
    try {
      return function();
    } catch (const std::exception& exception) {
      what = exception.what();
    } catch (...) {
      // as it says
    }
    throw NoLinearisation(fmt::format("its function `{}` has thrown \"{}\"", name, what));
  }

  const faultline_plant_table& table_;

 public:
  Signals states, inputs, outputs, parameters, disturbances;
  VectorXd x, u, p, d;
};

/// Moves x and u of `at` to the equilibrium nearest to where they are: Gauss-Newton steps from
/// there,
///   z <- z_0 + J⁺ (J (z - z_0) - f(z)),   J⁺ of least norm, all in sizes,
/// which end where f = 0 and z - z_0 lies in the range of Jᵀ, as the nearest point's must.
class EquilibriumSearch {
 public:
  EquilibriumSearch(Equations& at, const std::map<std::string, double, std::less<>>& hold)
      : at_(at), n_(at.x.size()), m_(at.u.size()) {
    x_size_ = numbers(at.states, &faultline_plant_signal::size);
    size_.resize(n_ + m_);
    size_ << x_size_, numbers(at.inputs, &faultline_plant_signal::size);
    is_free_.assign(static_cast<std::size_t>(n_ + m_), true);
    for (const auto& [name, value] : hold) fix(name, value);
  }

  void run() {
    const VectorXd start = point();
    VectorXd z = start;
    VectorXd f = scaled_f();
    for (int i = 0; i < kMostIterations && f.cwiseAbs().maxCoeff() > kRounding; ++i) {
      const MatrixXd J = scaled_jacobian();
      Eigen::CompleteOrthogonalDecomposition<MatrixXd> solver(J.rows(), J.cols());
      solver.setThreshold(kRankTolerance);
      solver.compute(J);
      const VectorXd target = start + solver.solve(J * (z - start) - f);
      const VectorXd direction = target - z;
      double part = 1.0;
      VectorXd f_next = try_point(target);
      // A step that leads nowhere better is halved, ten times at most.
      for (int halving = 0; halving < 10 && !(f_next.norm() < f.norm()); ++halving) {
        part *= 0.5;
        f_next = try_point(z + part * direction);
      }
      if (!(f_next.norm() < f.norm())) break;  // rounding, or a least that is not zero
      z += part * direction;
      f = f_next;
    }
    // What rounding leaves of a zero.
    set_point((z.cwiseAbs().array() < kRounding).select(0.0, z));
    report();
  }

 private:
  void fix(const std::string& name, double value) {
    std::vector<std::string> names = names_of(at_.states);
    const std::vector<std::string> inputs = names_of(at_.inputs);
    names.insert(names.end(), inputs.begin(), inputs.end());
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) {
      const auto near = nearest_name(name, names);
      throw std::invalid_argument(fmt::format(
          "hold: found \"{}\", expected a state or an input ({}){}", name, fmt::join(names, ", "),
          near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
    }
    const auto place = found - names.begin();
    is_free_[static_cast<std::size_t>(place)] = false;
    (place < n_ ? at_.x[place] : at_.u[place - n_]) = value;
  }
  [[nodiscard]] VectorXd point() const {
    VectorXd z(n_ + m_);
    z << at_.x, at_.u;
    return z.cwiseQuotient(size_);
  }
  void set_point(const VectorXd& z) {
    const VectorXd before = point();
    for (Index i = 0; i < n_ + m_; ++i) {
      if (z[i] == before[i]) continue;  // what does not move keeps its last digit
      (i < n_ ? at_.x[i] : at_.u[i - n_]) = z[i] * size_[i];
    }
  }
  [[nodiscard]] VectorXd scaled_f() const {
    const VectorXd f = at_.f();
    at_.check_finite(f, nullptr);
    return f.cwiseQuotient(x_size_);
  }
  [[nodiscard]] VectorXd try_point(const VectorXd& z) {
    const VectorXd x = at_.x;
    const VectorXd u = at_.u;
    set_point(z);
    const VectorXd f = at_.f().cwiseQuotient(x_size_);
    at_.x = x;
    at_.u = u;
    return f;
  }
  [[nodiscard]] MatrixXd scaled_jacobian() {
    MatrixXd J(n_, n_ + m_);
    J << at_.jacobian(at_.x, at_.states).value.topRows(n_),
        at_.jacobian(at_.u, at_.inputs).value.topRows(n_);
    J = x_size_.cwiseInverse().asDiagonal() * J * size_.asDiagonal();
    for (Index i = 0; i < n_ + m_; ++i) {
      if (!is_free_[static_cast<std::size_t>(i)]) J.col(i).setZero();
    }
    return J;
  }
  void report() const {
    const VectorXd f = scaled_f();
    std::vector<std::string> moving;
    for (Index i = 0; i < n_; ++i) {
      if (std::abs(f[i]) <= kRest_per_s) continue;
      moving.push_back(fmt::format("{} ({:.3g} per s)", at_.row_name(i), f[i] * x_size_[i]));
    }
    if (moving.empty()) return;
    throw NoLinearisation(
        fmt::format("found no equilibrium near the nominal point: what is left moves {}",
                    fmt::join(moving, ", ")));
  }

  Equations& at_;
  Index n_, m_;
  VectorXd x_size_, size_;
  std::vector<bool> is_free_;
};

void take_worst(const Jacobian& jacobian, Signals by, const Equations& at, const VectorXd& row_size,
                Linearisation& result) {
  for (Index j = 0; j < jacobian.error.cols(); ++j) {
    const faultline_plant_signal& variable = by[static_cast<std::size_t>(j)];
    for (Index i = 0; i < jacobian.error.rows(); ++i) {
      const double error =
          jacobian.error(i, j) * (variable.size > 0.0 ? variable.size : 1.0) / row_size[i];
      if (!(error > result.largest_error)) continue;
      result.largest_error = error;
      result.worst_entry = fmt::format("d({})/d({})", at.row_name(i), variable.name);
    }
  }
}

/// Sets to zero what rounding has left of an entry that is zero.
void drop_rounding(const VectorXd& row_size,
                   std::initializer_list<std::pair<Jacobian*, Signals>> all) {
  const auto size_of = [](Signals by, Index j) {
    const double size = by[static_cast<std::size_t>(j)].size;
    return size > 0.0 ? size : 1.0;
  };
  for (Index i = 0; i < row_size.size(); ++i) {
    double largest = 0.0;
    for (const auto& [jacobian, by] : all) {
      for (Index j = 0; j < jacobian->value.cols(); ++j) {
        largest = std::max(largest, std::abs(jacobian->value(i, j)) * size_of(by, j));
      }
    }
    for (const auto& [jacobian, by] : all) {
      for (Index j = 0; j < jacobian->value.cols(); ++j) {
        double& entry = jacobian->value(i, j);
        if (std::abs(entry) * size_of(by, j) < kNegligible * largest) entry = 0.0;
      }
    }
  }
}

void describe_channels(const Equations& at, PlantModel& model) {
  const auto units = [](Signals signals) {
    std::vector<std::string> texts;
    bool has_any = false;
    for (const faultline_plant_signal& signal : signals) {
      texts.emplace_back(signal.unit == nullptr ? "" : signal.unit);
      has_any = has_any || !texts.back().empty();
    }
    return has_any ? texts : std::vector<std::string>();
  };
  model.state_names = names_of(at.states);
  model.input_names = names_of(at.inputs);
  model.output_names = names_of(at.outputs);
  model.state_units = units(at.states);
  model.input_units = units(at.inputs);
  model.output_units = units(at.outputs);
  model.state_range = numbers(at.states, &faultline_plant_signal::size);
  model.input_range = numbers(at.inputs, &faultline_plant_signal::size);
  model.output_range = numbers(at.outputs, &faultline_plant_signal::size);
}

void add_faults(const Equations& at, const Jacobian& by_p, Linearisation& result) {
  PlantModel& model = result.model;
  const Index n = model.n();
  const Index q = model.q();
  const auto add = [&](const Fault& fault) {
    const std::vector<std::string> taken = model.fault_names();
    if (std::find(taken.begin(), taken.end(), fault.name) != taken.end()) {
      throw std::invalid_argument(
          fmt::format("found \"{}\" twice among inputs, outputs and "
                      "parameters, expected different names: faults are "
                      "told apart by them",
                      fault.name));
    }
    model.faults.push_back(fault);
  };
  for (Index j = 0; j < model.m(); ++j) {
    add({model.input_names[static_cast<std::size_t>(j)], FaultKind::kActuator, model.B.col(j),
         model.D.col(j)});
  }
  for (Index i = 0; i < q; ++i) {
    add({model.output_names[static_cast<std::size_t>(i)], FaultKind::kSensor, VectorXd::Zero(n),
         VectorXd::Unit(q, i)});
  }
  for (Index j = 0; j < by_p.value.cols(); ++j) {
    const faultline_plant_signal& parameter = at.parameters[static_cast<std::size_t>(j)];
    if (parameter.size == 0.0) continue;
    if (by_p.value.col(j).isZero(0.0)) {
      result.unseen.emplace_back(parameter.name);
      continue;
    }
    add({parameter.name, FaultKind::kComponent, by_p.value.col(j).head(n),
         by_p.value.col(j).tail(q), parameter.size});
  }
}

void add_disturbances(const Equations& at, const Jacobian& by_d, Linearisation& result) {
  PlantModel& model = result.model;
  for (Index j = 0; j < by_d.value.cols(); ++j) {
    const faultline_plant_signal& signal = at.disturbances[static_cast<std::size_t>(j)];
    const VectorXd state = by_d.value.col(j).head(model.n());
    const VectorXd output = by_d.value.col(j).tail(model.q());
    std::optional<double> bound;
    if (signal.size > 0.0) bound = signal.size;
    if (state.isZero(0.0) && output.isZero(0.0)) {
      result.unseen.emplace_back(signal.name);
    } else if (state.isZero(0.0) && bound) {
      model.noises.push_back({signal.name, output, bound, std::nullopt});
    } else {
      model.disturbances.push_back({signal.name, state, output, bound});
    }
  }
}

}  // namespace

Linearisation linearise(const faultline_plant_table& table, const LinearisationOptions& options) {
  Equations at(table, options.parameters);
  EquilibriumSearch(at, options.hold).run();
  const VectorXd y = at.h();
  const Index n = at.x.size();
  Jacobian by_x = at.jacobian(at.x, at.states);
  Jacobian by_u = at.jacobian(at.u, at.inputs);
  Jacobian by_p = at.jacobian(at.p, at.parameters);
  Jacobian by_d = at.jacobian(at.d, at.disturbances);
  VectorXd row_size(n + y.size());
  row_size << numbers(at.states, &faultline_plant_signal::size),
      numbers(at.outputs, &faultline_plant_signal::size);
  drop_rounding(
      row_size,
      {{&by_x, at.states}, {&by_u, at.inputs}, {&by_p, at.parameters}, {&by_d, at.disturbances}});

  Linearisation result;
  PlantModel& model = result.model;
  model.name = table.name;
  describe_channels(at, model);
  model.A = by_x.value.topRows(n);
  model.B = by_u.value.topRows(n);
  model.C = by_x.value.bottomRows(y.size());
  model.D = by_u.value.bottomRows(y.size());
  model.x_operating = at.x;
  model.u_operating = at.u;
  model.y_operating = y;
  add_faults(at, by_p, result);
  add_disturbances(at, by_d, result);
  take_worst(by_x, at.states, at, row_size, result);
  take_worst(by_u, at.inputs, at, row_size, result);
  take_worst(by_p, at.parameters, at, row_size, result);
  take_worst(by_d, at.disturbances, at, row_size, result);
  const Eigen::VectorXcd eigenvalues = model.A.eigenvalues();
  result.eigenvalues.assign(eigenvalues.begin(), eigenvalues.end());
  return result;
}

}  // namespace faultline
