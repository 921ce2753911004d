#include "diagnosis/certify/check.h"

#include <algorithm>
#include <functional>
#include <utility>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/certify/certify.h"
#include "diagnosis/design/design_bank.h"
#include "tests/diagnosis/certify/certify_cases.h"
#include "tests/diagnosis/geometric_oracle.h"
#include "tests/diagnosis/hou_plant.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::Contains;
using ::testing::Field;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::string all_sentences(const CheckResult& result) {
  std::string text;
  for (const CheckFinding& finding : result.findings) {
    text += sentence(finding) + "\n";
  }
  return text;
}

void expect_holds(const PlantModel& plant, const Bank& bank) {
  EXPECT_EQ(all_sentences(check_bank(plant, bank)), "");
  // And as it comes from a file.
  EXPECT_TRUE(check_bank(plant, parse_bank(bank_text(bank), "bank")).holds());
}

Bank certified_hou() {
  Bank bank = hou_bank();
  certify(hou_plant(), bank);
  return bank;
}

// One filter of several rows and states, a sensor fault, a disturbance: small, but no special case.
std::pair<PlantModel, Bank> multi_row(DesignDomain domain) {
  CertifyCase random = random_case(test_seed(60), 4, 2, 4, 1, domain);
  random.plant.faults.push_back(
      {"y1", FaultKind::kSensor, VectorXd::Zero(4), VectorXd::Unit(4, 0), 0.5});
  random.plant.disturbances.push_back({"d", VectorXd::Unit(4, 1), VectorXd::Zero(4), std::nullopt});
  random.request.decouple = {"d"};
  Bank bank = random.designed();
  bank.filters.resize(1);
  certify(random.plant, bank);
  return {random.plant, bank};
}

/// Every number of a filter's certificate, by name.
std::vector<std::pair<std::string, double*>> numbers_of(FilterCertificate& certificate) {
  std::vector<std::pair<std::string, double*>> numbers = {
      {"spectral_radius", &certificate.spectral_radius},
      {"band_Hz", &certificate.band_Hz},
      {"smallest_kept", &certificate.rank.smallest_kept},
      {"largest_dropped", &certificate.rank.largest_dropped},
      {"tolerance_min", &certificate.rank.tolerance_min},
      {"tolerance_max", &certificate.rank.tolerance_max}};
  const auto add = [&](const std::string& name, std::vector<double>& values) {
    for (std::size_t i = 0; i < values.size(); ++i) {
      numbers.emplace_back(fmt::format("{}[{}]", name, i), &values[i]);
    }
  };
  add("input_gain", certificate.input_gain);
  add("disturbance_gain", certificate.disturbance_gain);
  add("fault_gain", certificate.fault_gain);
  add("dc_gain", certificate.dc_gain);
  add("band_gain", certificate.band_gain);
  add("margin", certificate.margin);
  add("smallest_fault", certificate.smallest_fault);
  add("delay_s", certificate.delay_s);
  return numbers;
}

void expect_found(const PlantModel& plant, const Bank& bank, const std::string& what) {
  EXPECT_FALSE(check_bank(plant, bank).holds()) << what << " was tampered with";
}

void tamper_with_matrices(const PlantModel& plant, const Bank& bank) {
  using Member = MatrixXd ResidualFilter::*;
  const std::vector<std::pair<char, Member>> members = {
      {'F', &ResidualFilter::F}, {'E', &ResidualFilter::E}, {'G', &ResidualFilter::G},
      {'M', &ResidualFilter::M}, {'H', &ResidualFilter::H}, {'K', &ResidualFilter::K},
      {'L', &ResidualFilter::L}, {'J', &ResidualFilter::J}};
  for (std::size_t f = 0; f < bank.filters.size(); ++f) {
    for (const auto& [letter, member] : members) {
      const MatrixXd& matrix = bank.filters[f].*member;
      const double size = matrix.size() == 0 ? 0.0 : matrix.cwiseAbs().maxCoeff();
      for (Index i = 0; i < matrix.rows(); ++i) {
        for (Index j = 0; j < matrix.cols(); ++j) {
          Bank tampered = bank;
          (tampered.filters[f].*member)(i, j) += 1e-3 * (size > 0.0 ? size : 1.0);
          expect_found(plant, tampered,
                       fmt::format("{}: {}({}, {})", bank.filters[f].name, letter, i, j));
        }
      }
    }
  }
}

void tamper_with_certificates(const PlantModel& plant, const Bank& bank) {
  for (std::size_t f = 0; f < bank.filters.size(); ++f) {
    Bank tampered = bank;
    FilterCertificate& certificate = tampered.filters[f].certificate;
    for (const auto& [name, number] : numbers_of(certificate)) {
      const double before = *number;
      *number = 1.001 * before + 1e-4;
      expect_found(plant, tampered, name);
      *number = before;
    }
    for (std::uint32_t* dimension : {&certificate.rank.dim_w, &certificate.rank.dim_s}) {
      *dimension += 1;
      expect_found(plant, tampered, "a dimension");
      *dimension -= 1;
    }
  }
}

void tamper_with_the_rest(const PlantModel& plant, const Bank& bank) {
  using Change = std::function<void(Bank&)>;
  std::vector<std::pair<std::string, Change>> changes = {
      {"dwell", [](Bank& b) { b.decision.dwell += 1; }},
      {"sample_time_s", [](Bank& b) { b.sample_time_s *= 1.01; }},
      {"plant_name", [](Bank& b) { b.plant_name += "x"; }},
      {"plant_digest", [](Bank& b) { b.plant_digest[0] ^= 1; }},
      {"input_names", [](Bank& b) { std::swap(b.input_names[0], b.input_names[1]); }},
      {"output_names", [](Bank& b) { b.output_names[0] += "x"; }},
      {"fault_names", [](Bank& b) { b.fault_names[1] += "x"; }},
      {"fault_sizes", [](Bank& b) { b.fault_sizes[1] *= 1.001; }},
      {"u_operating", [](Bank& b) { b.u_operating[0] += 1e-3; }},
      {"y_operating", [](Bank& b) { b.y_operating[0] += 1e-3; }},
      {"signatures_distinct",
       [](Bank& b) {
         b.isolability.are_signatures_distinct = !b.isolability.are_signatures_distinct;
       }},
      {"strongly_isolable",
       [](Bank& b) { b.isolability.is_strongly_isolable = !b.isolability.is_strongly_isolable; }},
      {"list_complete", [](Bank& b) { b.isolability.is_list_complete = false; }},
      {"another confusable set",
       [](Bank& b) {
         b.isolability.confusable.push_back({{0, 1}, {}});
       }},
  };
  for (std::size_t i = 0; i < bank.isolability.confusable.size(); ++i) {
    changes.emplace_back("weight",
                         [i](Bank& b) { b.isolability.confusable[i].weights[0] += 1e-3; });
    changes.emplace_back("fault of a confusable set",
                         [i](Bank& b) { b.isolability.confusable[i].faults.pop_back(); });
  }
  for (std::size_t f = 0; f < bank.filters.size(); ++f) {
    changes.emplace_back("threshold", [f](Bank& b) { b.filters[f].threshold *= 1.001; });
    changes.emplace_back("forget_samples", [f](Bank& b) { b.filters[f].forget_samples += 1; });
    changes.emplace_back("forget_samples", [f](Bank& b) { b.filters[f].forget_samples -= 1; });
    changes.emplace_back("name", [f](Bank& b) { b.filters[f].name += "x"; });
    changes.emplace_back("ignores", [f](Bank& b) { b.filters[f].ignores.pop_back(); });
    for (std::size_t j = 0; j < bank.fault_names.size(); ++j) {
      changes.emplace_back("ignores", [f, j](Bank& b) {
        std::vector<std::size_t>& ignores = b.filters[f].ignores;
        if (std::find(ignores.begin(), ignores.end(), j) == ignores.end()) {
          ignores.push_back(j);
          std::sort(ignores.begin(), ignores.end());
        } else {
          ignores.erase(std::find(ignores.begin(), ignores.end(), j));
        }
      });
      for (const Sensitivity sees :
           {Sensitivity::kNone, Sensitivity::kTransient, Sensitivity::kSteady}) {
        if (bank.filters[f].sees[j] != sees) {
          changes.emplace_back("sees", [f, j, sees](Bank& b) { b.filters[f].sees[j] = sees; });
        }
      }
    }
  }
  for (std::size_t i = 0; i < bank.disturbances.size(); ++i) {
    changes.emplace_back("disturbance", [i](Bank& b) { b.disturbances[i].name += "x"; });
    changes.emplace_back("treatment", [i](Bank& b) {
      b.disturbances[i].treatment = BankDisturbance::Treatment::kNone;
    });
    changes.emplace_back("treatment", [i](Bank& b) {
      b.disturbances[i].treatment = BankDisturbance::Treatment::kConstant;
    });
  }
  for (const auto& [what, change] : changes) {
    Bank tampered = bank;
    change(tampered);
    expect_found(plant, tampered, what);
  }
}

TEST(CheckBank, FindsNothingWrongWithCertifiedBanks) {
  expect_holds(hou_plant(), certified_hou());
  for (const DesignDomain domain : {DesignDomain::kContinuous, DesignDomain::kSampled}) {
    const auto [plant, bank] = multi_row(domain);
    expect_holds(plant, bank);
    for (std::uint64_t seed = 61; seed < 66; ++seed) {
      SCOPED_TRACE(seed_message(test_seed(seed)));
      const CertifyCase random = random_case(test_seed(seed), 7, 4, 6, 2, domain);
      expect_holds(random.plant, random.certified());
    }
  }
}

TEST(CheckBank, FindsNothingWrongWithTheOraclesCases) {
  for (const OracleCase& oracle : oracle_cases()) {
    SCOPED_TRACE(oracle.name);
    const CertifyCase problem{oracle.plant(), oracle.request()};
    expect_holds(problem.plant, problem.certified());
  }
}

TEST(CheckBank, FindsNothingWrongWithPlantsInAnyUnit) {
  for (const DesignDomain domain : {DesignDomain::kContinuous, DesignDomain::kSampled}) {
    for (const double unit : {1e-12, 1e-6, 1e6, 1e12}) {
      SCOPED_TRACE(unit);
      CertifyCase random = random_case(test_seed(67), 5, 2, 4, 1, domain);
      PlantModel& plant = random.plant;
      plant.B.col(0) *= unit;
      plant.faults[0].state *= unit;
      plant.faults[0].size = 1.0 / unit;
      expect_holds(plant, random.certified());
    }
  }
}

TEST(CheckBank, FindsNothingWrongWithABankOfAnyKind) {
  PlantModel plant = hou_plant();
  plant.disturbances.push_back({"offset", VectorXd::Zero(3), VectorXd::Unit(3, 0), {}});
  for (const DesignDomain domain : {DesignDomain::kContinuous, DesignDomain::kSampled}) {
    BankRequest request = hou_request();
    request.domain = domain;
    request.poles.clear();
    request.decay_rate_per_s = 8.0;
    const auto expect_design_holds = [&] {
      DesignResult result = design_bank(plant, request);
      ASSERT_FALSE(result.bank.filters.empty());
      certify(plant, result.bank);
      expect_holds(plant, result.bank);
    };
    expect_design_holds();
    request.decouple_constant = {"offset"};
    expect_design_holds();
    request.structure = StructureChoice::kSmallest;
    expect_design_holds();
    request.structure = StructureChoice::kGiven;
    request.ignored_sets = {{}, {"u1"}, {"u2", "u4"}};
    expect_design_holds();
    request.normalise = false;
    request.decouple_constant.clear();
    expect_design_holds();
  }
}

TEST(CheckBank, FindsEveryEntryTamperedWithInHousBank) {
  tamper_with_matrices(hou_plant(), certified_hou());
}

TEST(CheckBank, FindsEveryNumberTamperedWithInHousCertificates) {
  tamper_with_certificates(hou_plant(), certified_hou());
}

TEST(CheckBank, FindsEverythingElseTamperedWithInHousBank) {
  tamper_with_the_rest(hou_plant(), certified_hou());
}

TEST(CheckBank, FindsEverythingTamperedWithInABankOfSeveralRows) {
  for (const DesignDomain domain : {DesignDomain::kContinuous, DesignDomain::kSampled}) {
    const auto [plant, bank] = multi_row(domain);
    ASSERT_GT(bank.filters[0].H.rows(), 1);
    ASSERT_GT(bank.filters[0].F.rows(), 1);
    tamper_with_matrices(plant, bank);
    tamper_with_certificates(plant, bank);
    tamper_with_the_rest(plant, bank);
  }
}

TEST(CheckBank, SaysWhichResidualAndWhichClaimInWords) {
  Bank bank = certified_hou();
  bank.filters[1].certificate.dc_gain[3] = 0.5;
  const CheckResult result = check_bank(hou_plant(), bank);
  ASSERT_EQ(result.findings.size(), 1u);
  EXPECT_EQ(sentence(result.findings[0]), "r13: gain of u4 at DC: the bank says 0.5, but it is 1");
}

TEST(CheckBank, DoesNotMindRoundingErrors) {
  Bank bank = certified_hou();
  for (ResidualFilter& filter : bank.filters) {
    FilterCertificate& certificate = filter.certificate;
    for (const auto& [name, number] : numbers_of(certificate)) {
      *number *= 1.0 + 1e-12;
    }
    certificate.rank.largest_dropped += 1e-15;
    for (const std::size_t j : filter.ignores) {
      certificate.dc_gain[j] += 1e-14;
      certificate.margin[j] += 1e-15;
    }
  }
  EXPECT_EQ(all_sentences(check_bank(hou_plant(), bank)), "");
}

TEST(CheckBank, NamesAFaultThatIsSeenButShouldBeIgnored) {
  Bank bank = certified_hou();
  bank.filters[0].G(0, 0) += 0.5;
  bank.filters[0].E(0, 1) += 5.0;
  const CheckResult result = check_bank(hou_plant(), bank);
  EXPECT_THAT(result.findings, Contains(Field(&CheckFinding::claim, "it ignores fault u2")));
  EXPECT_THAT(result.findings, Contains(Field(&CheckFinding::claim, "it ignores input u1")));
  EXPECT_THAT(result.findings, Contains(Field(&CheckFinding::subject, "r12")));
}

TEST(CheckBank, FindsAnotherPlant) {
  PlantModel other = hou_plant();
  other.A(0, 0) += 1e-3;
  const CheckResult result = check_bank(other, certified_hou());
  EXPECT_THAT(all_sentences(result), HasSubstr("bank: digest of the plant"));
  PlantModel larger = hou_plant();
  larger.faults.pop_back();
  const CheckResult refused = check_bank(larger, certified_hou());
  EXPECT_THAT(all_sentences(refused), HasSubstr("bank: faults"));
  EXPECT_THAT(refused.certificates, IsEmpty());
}

TEST(CheckBank, FindsAnUnstableFilterAndGoesOnWithTheOthers) {
  Bank bank = certified_hou();
  bank.filters[0].F(0, 0) = 1.01;
  const CheckResult result = check_bank(hou_plant(), bank);
  ASSERT_EQ(result.findings.size(), 1u);
  EXPECT_THAT(sentence(result.findings[0]), HasSubstr("r12: certificate"));
  EXPECT_THAT(sentence(result.findings[0]), HasSubstr("stable"));
  EXPECT_EQ(result.certificates.size(), 6u);
}

TEST(CheckBank, FindsThatAPlantCannotBeSampledSoSlowly) {
  Bank bank = certified_hou();
  bank.sample_time_s = 1e6;
  EXPECT_THAT(all_sentences(check_bank(hou_plant(), bank)), HasSubstr("too unstable"));
}

TEST(CheckBank, FindsAResidualThatSeesNothing) {
  Bank bank = certified_hou();
  ResidualFilter& filter = bank.filters[0];
  filter.sees.assign(4, Sensitivity::kNone);
  EXPECT_THAT(all_sentences(check_bank(hou_plant(), bank)),
              HasSubstr("a residual that sees none serves nothing"));
}

}  // namespace
}  // namespace faultline
