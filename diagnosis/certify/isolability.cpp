#include "diagnosis/certify/isolability.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <random>
#include <set>
#include <unordered_set>

#include <Eigen/LU>
#include <Eigen/QR>

#include "diagnosis/certify/balance.h"
#include "diagnosis/certify/sampled_plant.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXcd;
using Eigen::VectorXd;
using Complex = std::complex<double>;
using FaultSet = std::vector<std::size_t>;

constexpr std::size_t kFrequencies = 3;
constexpr unsigned kSeed = 20150611;
constexpr std::size_t kMostSets = 200'000;
constexpr std::size_t kMostListed = 1000;
// A column of unit size whose distance from the others' span is below this depends on them: as the
// rank tolerance of the margins.
constexpr double kDependent = 1e-9;
// Coefficients below this part of the largest are zero: a member that hardly takes part is none.
constexpr double kNoPart = 1e-6;
// Weights that agree this far at all frequencies are the same.
constexpr double kSameWeight = 1e-6;

// Transfer matrix of the faults at one λ, modulo the decoupled disturbances, in units in which its
// rows are of about the same size.
MatrixXcd fault_columns(const DomainModel& model, Complex lambda, const VectorXd& state_units) {
  const Index n = model.A.rows();
  const Index k = model.fault_states.cols();
  const Index l = model.decoupled_states.cols();
  const VectorXd inverse = state_units.cwiseInverse();
  MatrixXd states(n, k + l);
  states << model.fault_states, model.decoupled_states;
  MatrixXd outputs(model.C.rows(), k + l);
  outputs << model.fault_outputs, model.decoupled_outputs;
  MatrixXcd T = outputs.cast<Complex>();
  if (n > 0) {
    const MatrixXd A = inverse.asDiagonal() * model.A * state_units.asDiagonal();
    const MatrixXcd pencil = lambda * MatrixXcd::Identity(n, n) - A;
    const MatrixXcd states_at =
        pencil.partialPivLu().solve((inverse.asDiagonal() * states).cast<Complex>());
    T += (model.C * state_units.asDiagonal()) * states_at;
  }
  for (Index i = 0; i < T.rows(); ++i) {
    T.row(i) /= power_of_two(T.row(i).norm());
  }
  MatrixXcd faults = T.leftCols(k);
  if (l > 0) {
    MatrixXcd disturbances = T.rightCols(l);
    for (Index j = 0; j < l; ++j) {
      const double norm = disturbances.col(j).norm();
      disturbances.col(j) /= norm > 0.0 ? norm : 1.0;
    }
    Eigen::ColPivHouseholderQR<MatrixXcd> qr(disturbances.rows(), l);
    qr.setThreshold(kDependent);
    qr.compute(disturbances);
    const MatrixXcd Q = qr.householderQ() * MatrixXcd::Identity(T.rows(), qr.rank());
    for (int pass = 0; pass < 2; ++pass) {
      faults -= Q * (Q.adjoint() * faults).eval();
    }
  }
  // What the projection left as rounding errors is zero.
  for (Index j = 0; j < k; ++j) {
    if (faults.col(j).norm() <= kDependent * T.col(j).norm()) {
      faults.col(j).setZero();
    }
  }
  return faults;
}

// Finds all circuits by going through the independent sets in lexicographic order, each extended by
// one column at a time: a column that depends on an independent set closes exactly one circuit.
class CircuitSearch {
 public:
  CircuitSearch(const DomainModel& model, std::size_t largest)
      : fault_count_(static_cast<std::size_t>(model.fault_states.cols())), largest_(largest) {
    const VectorXd units = state_scales(model.A, model.fault_states, model.C);
    const MatrixXd A = units.cwiseInverse().asDiagonal() * model.A * units.asDiagonal();
    const double rate = model.is_sampled ? 1.0 : A.norm() > 0.0 ? A.norm() : 1.0;
    std::mt19937_64 engine(kSeed);
    std::uniform_real_distribution<double> part(0.5, 1.5);
    for (Level& level : levels_) {
      const double real = part(engine);
      const MatrixXcd columns = fault_columns(model, rate * Complex(real, part(engine)), units);
      level.norms = columns.colwise().norm().transpose();
      level.columns = columns;
      for (Index j = 0; j < columns.cols(); ++j) {
        level.columns.col(j) /= level.norms[j] > 0.0 ? level.norms[j] : 1.0;
      }
      level.basis = MatrixXcd(columns.rows(), static_cast<Index>(largest_));
      level.triangle = MatrixXcd::Zero(static_cast<Index>(largest_), static_cast<Index>(largest_));
    }
  }

  void run(IsolabilityCertificate& certificate) {
    if (!are_all_independent()) {
      extend(0);
    }
    certificate.is_list_complete = is_complete_;
    certificate.is_strongly_isolable = is_complete_ && found_.empty();
    certificate.confusable.assign(found_.begin(), found_.end());
  }

 private:
  // One frequency: unit columns, and the Gram-Schmidt basis of the current set.
  struct Level {
    MatrixXcd columns, basis, triangle;
    VectorXd norms;
  };
  struct BySizeThenFaults {
    bool operator()(const ConfusableFaults& a, const ConfusableFaults& b) const {
      return a.faults.size() != b.faults.size() ? a.faults.size() < b.faults.size()
                                                : a.faults < b.faults;
    }
  };

  // Then so are all sets of columns.
  [[nodiscard]] bool are_all_independent() const {
    return std::any_of(levels_.begin(), levels_.end(), [](const Level& level) {
      const Index k = level.columns.cols();
      if (k == 0 || k > level.columns.rows()) {
        return k == 0;
      }
      const Eigen::ColPivHouseholderQR<MatrixXcd> qr(level.columns);
      return std::abs(qr.matrixQR()(k - 1, k - 1)) > kDependent;
    });
  }

  void extend(std::size_t begin) {
    for (std::size_t j = begin; j < fault_count_ && is_complete_; ++j) {
      if (++looked_at_ > kMostSets) {
        is_complete_ = false;
        return;
      }
      if (!add(j)) {
        note_circuit(j);
        continue;
      }
      set_.push_back(j);
      if (set_.size() < largest_) {
        extend(j + 1);
      }
      set_.pop_back();
    }
  }

  // Puts column j behind the bases; whether it is independent of the set at one frequency at least.
  bool add(std::size_t j) {
    const auto size = static_cast<Index>(set_.size());
    const auto column = static_cast<Index>(j);
    bool is_independent = false;
    for (Level& level : levels_) {
      VectorXcd rest = level.columns.col(column);
      VectorXcd parts = VectorXcd::Zero(size);
      for (int pass = 0; pass < 2; ++pass) {  // twice is enough
        const VectorXcd part = level.basis.leftCols(size).adjoint() * rest;
        rest -= level.basis.leftCols(size) * part;
        parts += part;
      }
      const double distance = rest.norm();
      is_independent = is_independent || distance > kDependent;
      level.triangle.col(size).head(size) = parts;
      level.triangle(size, size) = distance;
      level.basis.col(size) = distance > 0.0 ? VectorXcd(rest / distance) : rest;
    }
    return is_independent;
  }

  void note_circuit(std::size_t j) {
    const auto size = static_cast<Index>(set_.size());
    // Null vector of [set, j] at each frequency, in the columns' own units.
    std::array<VectorXcd, kFrequencies> null;
    for (std::size_t f = 0; f < kFrequencies; ++f) {
      const Level& level = levels_[f];
      null[f] = VectorXcd(size + 1);
      null[f].head(size) = -level.triangle.topLeftCorner(size, size)
                                .triangularView<Eigen::Upper>()
                                .solve(level.triangle.col(size).head(size));
      null[f][size] = 1.0;
    }
    ConfusableFaults circuit;
    std::vector<Index> members;
    for (Index i = 0; i <= size; ++i) {
      if (std::abs(null[0][i]) > kNoPart * null[0].cwiseAbs().maxCoeff()) {
        members.push_back(i);
        circuit.faults.push_back(i < size ? set_[static_cast<std::size_t>(i)] : j);
      }
    }
    if (found_.count(circuit) > 0) {
      return;
    }
    circuit.weights = weights_of(null, members, circuit.faults);
    if (found_.size() == kMostListed) {
      is_complete_ = false;
      return;
    }
    found_.insert(std::move(circuit));
  }

  // The null vector per unit of fault if it is real and the same at all frequencies.
  [[nodiscard]] std::vector<double> weights_of(const std::array<VectorXcd, kFrequencies>& null,
                                               const std::vector<Index>& members,
                                               const FaultSet& faults) const {
    const auto count = std::ssize(members);
    std::array<VectorXcd, kFrequencies> weights;
    for (std::size_t f = 0; f < kFrequencies; ++f) {
      weights[f] = VectorXcd(count);
      for (Index i = 0; i < count; ++i) {
        const double norm =
            levels_[f].norms[static_cast<Index>(faults[static_cast<std::size_t>(i)])];
        weights[f][i] = null[f][members[static_cast<std::size_t>(i)]] / (norm > 0.0 ? norm : 1.0);
      }
    }
    // The first of the largest leads; ties up to rounding count as ties.
    const VectorXd sizes = weights[0].cwiseAbs();
    Index lead = 0;
    while (sizes[lead] < (1.0 - kSameWeight) * sizes.maxCoeff()) {
      ++lead;
    }
    std::vector<double> result;
    for (Index i = 0; i < count; ++i) {
      const Complex first = weights[0][i] / weights[0][lead];
      for (const VectorXcd& at : weights) {
        const Complex weight = at[i] / at[lead];
        if (std::abs(weight - first) > kSameWeight || std::abs(weight.imag()) > kSameWeight) {
          return {};
        }
      }
      result.push_back(i == lead ? 1.0 : first.real());
    }
    return result;
  }

  std::size_t fault_count_;
  std::size_t largest_;
  std::array<Level, kFrequencies> levels_;
  FaultSet set_;
  std::set<ConfusableFaults, BySizeThenFaults> found_;
  std::size_t looked_at_ = 0;
  bool is_complete_ = true;
};

}  // namespace

bool are_signatures_distinct(const Bank& bank) {
  std::vector<std::vector<bool>> seen_by;  // per fault
  for (std::size_t j = 0; j < bank.fault_names.size(); ++j) {
    std::vector<bool> column;
    for (const ResidualFilter& filter : bank.filters) {
      // What fades, and is told from what stays, leaves no mark in the end.
      const bool fades = filter.transient_samples > 0 && filter.sees[j] == Sensitivity::kTransient;
      column.push_back(filter.sees[j] != Sensitivity::kNone && !fades);
    }
    seen_by.push_back(std::move(column));
  }
  std::unordered_set<std::vector<bool>> signatures;
  const auto is_new_for_all = [&](const auto& self, const std::vector<bool>& signature,
                                  std::size_t begin, std::size_t left) -> bool {
    if (!signatures.insert(signature).second) {
      return false;
    }
    for (std::size_t j = begin; left > 0 && j < seen_by.size(); ++j) {
      std::vector<bool> larger = signature;
      for (std::size_t i = 0; i < larger.size(); ++i) {
        larger[i] = larger[i] || seen_by[j][i];
      }
      if (!self(self, larger, j + 1, left - 1)) {
        return false;
      }
    }
    return true;
  };
  return is_new_for_all(is_new_for_all, std::vector<bool>(bank.filters.size()), 0, bank.concurrent);
}

IsolabilityCertificate analyse_isolability(const PlantModel& plant, const Bank& bank) {
  const DomainModel model = domain_model(plant, bank);
  IsolabilityCertificate certificate;
  certificate.are_signatures_distinct = are_signatures_distinct(bank);
  CircuitSearch search(model, std::min(2 * bank.concurrent, plant.faults.size()));
  search.run(certificate);
  return certificate;
}

}  // namespace faultline
