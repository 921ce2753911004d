#include "diagnosis/design/eigenstructure/eigenstructure_residual.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/design/eigenstructure/weakened_residual.h"
#include "diagnosis/design/joined_matrices.h"
#include "diagnosis/design/requested_poles.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// The plant in balanced units, on the outputs that ignored output directions leave.
struct ProjectedPlant {
  MatrixXd A, C, L;
  MatrixXd N;        // q×(outputs left), orthonormal: C = Nᵀ C_b
  MatrixXd reached;  // basis of what of these outputs anything reaches
};

ProjectedPlant projected_plant(const DesignModel& model, const Directions& ignored,
                               const Balance& units) {
  SubspaceArithmetic arithmetic;
  const Directions directions = units.of_directions(ignored);
  const Directions faults = units.of_directions(model.faults);
  const MatrixXd C_b = units.of_output(model.C);
  ProjectedPlant plant;
  plant.A = units.of_state(model.A);
  plant.N = arithmetic.kernel(unit_columns(directions.output).transpose(), 1.0);
  plant.C = plant.N.transpose() * C_b;
  plant.L = directions.state;
  plant.reached = arithmetic.image(
      side_by_side(
          plant.C / data_scale(C_b),
          plant.N.transpose() * unit_columns(side_by_side(directions.output, faults.output))),
      1.0);
  return plant;
}

// Rows of the residual in which no state shows: of what anything reaches, what is not Im C.
MatrixXd static_weights(const ProjectedPlant& plant, SubspaceArithmetic& arithmetic) {
  const MatrixXd basis =
      plant.reached *
      arithmetic.kernel((plant.C / data_scale(plant.C)).transpose() * plant.reached, 1.0);
  return canonical_rows(basis * basis.transpose(), basis.cols());
}

// P = H = W C with orthonormal rows, A_0 = 0, H A = X C; static rows below.
GeometricQuotient left_quotient(const DesignModel& model, const ProjectedPlant& plant,
                                const GeometricQuotient& geometric) {
  SubspaceArithmetic arithmetic;
  const Balance& units = geometric.units;
  const MatrixXd W = left_weights(plant.A, plant.C, plant.L, arithmetic);
  const MatrixXd C_inverse = arithmetic.pseudo_inverse(plant.C, data_scale(plant.C));
  const MatrixXd row_space = arithmetic.image((W * plant.C).transpose(), data_scale(plant.C));
  const Index p = row_space.cols();
  const MatrixXd P_b = canonical_rows(row_space * row_space.transpose(), p);
  const MatrixXd W_static = static_weights(plant, arithmetic);
  const Index s = W_static.rows();
  const MatrixXd H_b = stacked(P_b * C_inverse, W_static) * plant.N.transpose();
  const MatrixXd E_b = -P_b * plant.A * C_inverse * plant.N.transpose();

  GeometricQuotient quotient = geometric;
  quotient.P = P_b * units.state.cwiseInverse().asDiagonal();
  quotient.H = H_b * units.output.cwiseInverse().asDiagonal();
  quotient.M = stacked(MatrixXd::Identity(p, p), MatrixXd::Zero(s, p));
  quotient.A_0 = MatrixXd::Zero(p, p);
  quotient.E_0 = E_b * units.output.cwiseInverse().asDiagonal();
  quotient.visible_margin = visible_margins(P_b, E_b, H_b, units.of_directions(model.faults));
  return quotient;
}

std::string complex_text(const std::vector<std::complex<double>>& values) {
  std::vector<std::string> texts;
  for (const std::complex<double> value : values) {
    texts.push_back(value.imag() == 0.0
                        ? fmt::format("{:.4g}", value.real())
                        : fmt::format("{:.4g}{:+.4g}i", value.real(), value.imag()));
  }
  return fmt::format("{}", fmt::join(texts, ", "));
}

bool are_stable(const std::vector<std::complex<double>>& values, bool is_sampled) {
  return std::all_of(values.begin(), values.end(), [&](std::complex<double> value) {
    return is_sampled ? std::abs(value) < 1.0 : value.real() < 0.0;
  });
}

class ResidualAssignment {
 public:
  ResidualAssignment(const PlantModel& plant, const DesignModel& model, const BankRequest& request,
                     const std::string& name, const FaultSet& ignores)
      : plant_(plant),
        model_(model),
        request_(request),
        name_(name),
        ignores_(ignores),
        ignored_(ignored_directions(model, ignores)) {
    found_.report.name = name;
  }

  EigenstructureResidual run() {
    find();
    if (!found_.reason.empty()) {
      found_.report.explanation = found_.reason;
    }
    return std::move(found_);
  }

 private:
  void find() {
    found_.quotient = geometric_quotient(model_.A, model_.C, ignored_, model_.faults);
    if (found_.quotient.H.rows() == 0) {
      found_.report.explanation = "no residual of any kind is without these unknown inputs";
      note_existence();
    } else if (model_.weakened.state.cols() > 0 && !can_decouple_weakened()) {
      weaken();
    } else {
      assign();
    }
  }

  [[nodiscard]] bool is_ignored(std::size_t fault) const {
    return std::find(ignores_.begin(), ignores_.end(), fault) != ignores_.end();
  }

  [[nodiscard]] bool sees_all_of(const GeometricQuotient& quotient,
                                 const GeometricQuotient& other) const {
    for (std::size_t j = 0; j < plant_.faults.size(); ++j) {
      if (!is_ignored(j) && other.visible_margin[j] > kRankTolerance &&
          quotient.visible_margin[j] <= kRankTolerance) {
        return false;
      }
    }
    return true;
  }

  // Nothing needs to be weakened that can be kept out without losing sight of a fault.
  [[nodiscard]] bool can_decouple_weakened() {
    const Directions all{side_by_side(ignored_.state, model_.weakened.state),
                         side_by_side(ignored_.output, model_.weakened.output)};
    const GeometricQuotient quotient = geometric_quotient(model_.A, model_.C, all, model_.faults);
    if (quotient.H.rows() == 0 || !sees_all_of(quotient, found_.quotient)) {
      return false;
    }
    ignored_ = all;
    found_.quotient = quotient;
    return true;
  }

  void note_existence() {
    const ProjectedPlant plant = projected_plant(model_, ignored_, found_.quotient.units);
    SubspaceArithmetic arithmetic;
    found_.report.static_rows = static_weights(plant, arithmetic).rows();
    if (plant.C.rows() > 0) {
      found_.report.existence = decoupling_existence(plant.A, plant.C, plant.L);
    }
  }

  void assign() {
    note_existence();
    EigenstructureReport& report = found_.report;
    const DecouplingExistence& existence = report.existence;
    const bool is_right_possible =
        existence.is_right_solvable && are_stable(existence.zeros, model_.is_sampled);
    if (found_.quotient.P.rows() == 0) {
      report.assignment = "static";
      report.explanation =
          "what is left checks sensors against each other; no state enters, and no pole";
      return;
    }
    if (ignored_.state.isZero(0.0)) {
      report.assignment = "observer";
      report.explanation = "nothing that it ignores enters the states: any observer will do";
      return;
    }
    const AssignmentChoice choice = request_.eigenstructure.assignment;
    if (choice == AssignmentChoice::kBest || choice == AssignmentChoice::kLeft) {
      if (try_left(choice == AssignmentChoice::kLeft)) {
        return;
      }
    }
    if (choice == AssignmentChoice::kLeft) {
      return;
    }
    if (choice == AssignmentChoice::kRight && !is_right_possible) {
      found_.reason = no_right();
      return;
    }
    const std::string why_not_left =
        choice == AssignmentChoice::kBest ? why_not_left_ + "; " : std::string();
    if (is_right_possible && choice != AssignmentChoice::kGeometric) {
      report.assignment = "right";
      report.explanation = fmt::format(
          "{}the unknown inputs' directions are right eigenvectors of A - K C{}", why_not_left,
          existence.zeros.empty()
              ? std::string()
              : fmt::format("; its invariant zeros {} stay there and do not show in the residual",
                            complex_text(existence.zeros)));
      return;
    }
    report.assignment = "geometric";
    report.explanation =
        choice == AssignmentChoice::kGeometric
            ? fmt::format("asked for; rank C W* = {} < rank C = {}", existence.rank_CW,
                          existence.rank_C)
            : fmt::format("{}{}; the geometric quotient does without: rank C W* = {} < rank C = {}",
                          why_not_left, no_right(), existence.rank_CW, existence.rank_C);
  }

  [[nodiscard]] std::string no_right() const {
    const DecouplingExistence& existence = found_.report.existence;
    if (existence.is_right_solvable) {
      return fmt::format("right eigenvectors leave the unstable invariant zero{} {} in A - K C",
                         existence.zeros.size() == 1 ? "" : "s", complex_text(existence.zeros));
    }
    return existence.rank_CE == existence.rank_C
               ? fmt::format("no right eigenvectors: rank CE = rank C = {} leaves no weight",
                             existence.rank_C)
               : std::string("no right eigenvectors: K C E = A E - E Λ has no solution");
  }

  bool try_left(bool is_demanded) {
    const ProjectedPlant plant = projected_plant(model_, ignored_, found_.quotient.units);
    const DecouplingExistence& existence = found_.report.existence;
    if (existence.left_rows == 0) {
      why_not_left_ = fmt::format(
          "no left eigenvectors: w [CE, C A N_C] = 0 has no solution with w C not zero (rank C = "
          "{}, rank CE = {})",
          existence.rank_C, existence.rank_CE);
      if (is_demanded) {
        found_.reason = why_not_left_;
      }
      return false;
    }
    GeometricQuotient quotient = left_quotient(model_, plant, found_.quotient);
    if (!is_demanded && !sees_all_of(quotient, found_.quotient)) {
      why_not_left_ = fmt::format("{} left eigenvector{} would see less",
                                  existence.left_rows == 1 ? "one" : "so few",
                                  existence.left_rows == 1 ? "" : "s");
      return false;
    }
    found_.quotient = std::move(quotient);
    found_.report.assignment = "left";
    found_.report.explanation = fmt::format(
        "{} row{} of W C {} of A - K C; the other modes do not show in the residual",
        existence.left_rows, existence.left_rows == 1 ? "" : "s",
        existence.left_rows == 1 ? "is a left eigenvector" : "span a left invariant subspace");
    return true;
  }

  // What reaches the quotient's residual, per unit `sizes`.
  [[nodiscard]] Directions in_quotient(const Directions& directions) const {
    const GeometricQuotient& quotient = found_.quotient;
    return {quotient.P * directions.state + quotient.E_0 * directions.output,
            quotient.H * directions.output};
  }

  void weaken() {
    note_existence();
    const GeometricQuotient& quotient = found_.quotient;
    Directions wanted{MatrixXd(model_.A.rows(), 0), MatrixXd(model_.C.rows(), 0)};
    for (std::size_t j = 0; j < plant_.faults.size(); ++j) {
      if (is_ignored(j) || quotient.visible_margin[j] <= kRankTolerance) {
        continue;
      }
      const auto column = static_cast<Index>(j);
      const double size = plant_.faults[j].size;
      wanted.state = side_by_side(wanted.state, size * model_.faults.state.col(column));
      wanted.output = side_by_side(wanted.output, size * model_.faults.output.col(column));
    }
    if (wanted.state.cols() == 0) {
      return;  // it sees no fault: the caller says so
    }
    const CompromiseTask task{quotient.A_0, quotient.M, in_quotient(model_.weakened),
                              in_quotient(wanted), model_.is_sampled};
    WeakenedResidual weakened = weakened_residual(quotient, task, request_, name_);
    found_.report.weakening.push_back(std::move(weakened.report));
    found_.reason = std::move(weakened.reason);
    if (!found_.reason.empty()) {
      return;
    }
    found_.quotient = std::move(weakened.quotient);
    found_.filter = std::move(weakened.filter);
    found_.report.assignment = "weakened";
    found_.report.explanation =
        "the unknown inputs to be weakened cannot be kept out without losing sight of a fault";
  }

  const PlantModel& plant_;
  const DesignModel& model_;
  const BankRequest& request_;
  const std::string& name_;
  const FaultSet& ignores_;
  Directions ignored_;
  std::string why_not_left_;
  EigenstructureResidual found_;
};

}  // namespace

EigenstructureResidual eigenstructure_residual(const PlantModel& plant, const DesignModel& model,
                                               const BankRequest& request, const std::string& name,
                                               const FaultSet& ignores) {
  return ResidualAssignment(plant, model, request, name, ignores).run();
}

}  // namespace faultline
