#include "diagnosis/certify/check_observer.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "diagnosis/certify/findings.h"
#include "diagnosis/certify/observer_proof.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Rounding errors of a matrix: of its largest entry.
constexpr double kMatrixNoise = 1e-12;
// Rounding errors of spectral radii; those of dead-beat observers are nothing else.
constexpr double kRadiusNoise = 1e-9;

double noise_of(const MatrixXd& X) {
  return X.size() == 0 ? 0.0 : kMatrixNoise * X.cwiseAbs().maxCoeff();
}

class ObserverCheck {
 public:
  ObserverCheck(const ResidualFilter& filter, CheckResult& result)
      : filter_(filter), findings_(result, filter.name) {}

  void run(const ObserverProof& proof) {
    check_form(proof.form);
    check_course(proof.thresholds);
    check_certificate(proof);
    if (filter_.estimation) {
      findings_.compare("bound of its estimate", filter_.estimation->bound, proof.estimation_bound,
                        0.0);
      check_count("samples its estimate settles in", filter_.estimation->settle_samples,
                  proof.settle);
    }
    check_count("samples that a fault seen in transients makes it fire for",
                filter_.transient_samples, proof.transient);
    check_count("samples that a bad sample contaminates it for", filter_.forget_samples,
                proof.forget);
  }

 private:
  void check_matrix(const char* name, const MatrixXd& stored, const MatrixXd& found) {
    findings_.compare(fmt::format("{} of the observer", name), stored, found, noise_of(found));
  }

  void check_form(const ObserverForm& form) {
    check_matrix("F", filter_.F, form.F);
    check_matrix("E", filter_.E, form.E);
    check_matrix("G", filter_.G, form.G);
    check_matrix("M", filter_.M, form.M);
    check_matrix("H", filter_.H, form.H);
    check_matrix("K", filter_.K, form.K);
    if (filter_.nonlinearities.size() != form.nonlinearities.size()) {
      findings_.add("Lipschitz terms", fmt::format("{}", filter_.nonlinearities.size()),
                    fmt::format("{}", form.nonlinearities.size()));
      return;
    }
    for (std::size_t i = 0; i < form.nonlinearities.size(); ++i) {
      check_term(i, filter_.nonlinearities[i], form.nonlinearities[i]);
    }
  }

  void check_term(std::size_t i, const FilterNonlinearity& stored,
                  const FilterNonlinearity& found) {
    const std::string of = fmt::format(" of Lipschitz term {}", i + 1);
    if (stored.function != found.function) {
      findings_.add("function" + of, function_name(stored.function.kind),
                    stored.function.kind == found.function.kind
                        ? "the same with other numbers"
                        : function_name(found.function.kind));
    }
    findings_.compare("middle of the slopes" + of, stored.center, found.center,
                      kMatrixNoise * found.radius);
    findings_.compare("half range of the slopes" + of, stored.radius, found.radius, 0.0);
    findings_.compare("W" + of, stored.W, found.W, noise_of(found.W));
    findings_.compare("a_v" + of, stored.a_v, found.a_v, noise_of(found.a_v));
    findings_.compare("a_y" + of, stored.a_y, found.a_y, noise_of(found.a_v));
    findings_.compare("a_u" + of, stored.a_u, found.a_u, noise_of(found.a_v));
  }

  void check_course(const ObserverThresholds& found) {
    const bool is_component = filter_.evaluation == Evaluation::kComponent;
    findings_.compare("threshold in the end", filter_.threshold,
                      is_component ? 1.0 : *(found.norm.end() - 1), 0.0);
    if (!filter_.course) {
      findings_.add("thresholds from the first sample on", "there are none",
                    fmt::format("{} samples of them", found.component.rows()));
      return;
    }
    findings_.compare_courses("componentwise threshold", filter_.course->component,
                              found.component);
    findings_.compare_courses("quadratic threshold", filter_.course->norm, found.norm);
  }

  void check_certificate(const ObserverProof& proof) {
    const ObserverCertificate& stored = *filter_.observer;
    compare_lists("spectral radius at a corner of the slopes", stored.vertex_radius,
                  proof.vertex_radius, kRadiusNoise);
    std::vector<double> guaranteed = proof.nominal_fault;
    for (double& size : guaranteed) size *= 2.0;
    compare_lists("fault that reaches the threshold", stored.nominal_fault, proof.nominal_fault,
                  0.0);
    compare_lists("fault that nothing hides", stored.guaranteed_fault, guaranteed, 0.0);
    if (proof.beta && !is_beta_true(stored.beta, *proof.beta)) {
      findings_.add("least gain in the band (beta)", number_text(stored.beta),
                    "at most " + number_text(*proof.beta));
    }
  }

  void compare_lists(const char* claim, const std::vector<double>& stored,
                     const std::vector<double>& found, double noise) {
    const auto as_vector = [](const std::vector<double>& list) {
      return VectorXd(VectorXd::Map(list.data(), std::ssize(list)));
    };
    findings_.compare(claim, as_vector(stored), as_vector(found), noise);
  }

  void check_count(const char* claim, std::uint32_t stored, const SampleCount& found) {
    if (!found.allows(stored)) {
      findings_.add(claim, fmt::format("{}", stored), fmt::format("{}", found.value));
    }
  }

  const ResidualFilter& filter_;
  Findings findings_;
};

// Only an observer's bounds prove these.
void check_plain(const Bank& bank, const ResidualFilter& filter, Findings findings) {
  const bool is_certified = bank.thresholds.kind == ThresholdBasis::Kind::kCertified;
  const auto refuse = [&](bool is_claimed, const char* claim) {
    if (is_claimed) findings.add(claim, "an observer's", "no observer's");
  };
  refuse(!filter.nonlinearities.empty(), "Lipschitz terms");
  refuse(filter.course.has_value() && !is_certified, "thresholds from the first sample on");
  refuse(filter.estimation.has_value(), "bound of its estimate");
  refuse(filter.evaluation != Evaluation::kNorm && !is_certified, "evaluation row by row");
  refuse(filter.transient_samples != 0,
         "samples that a fault seen in transients makes it fire for");
}

}  // namespace

void check_observer(const PlantModel& plant, const Bank& bank, const ResidualFilter& filter,
                    CheckResult& result) {
  Findings findings(result, filter.name);
  if (!filter.observer) {
    check_plain(bank, filter, findings);
    return;
  }
  try {
    ObserverCheck(filter, result).run(prove_observer(plant, bank, filter));
  } catch (const std::invalid_argument& error) {
    findings.add("observer", "a proof", error.what());
  }
}

}  // namespace faultline
