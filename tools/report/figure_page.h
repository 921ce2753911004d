#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace faultline {

/// A figure of a publication, made again from a run.
struct Figure {
  std::string title;
  std::string log;                     ///< file name in the folder of logs
  std::vector<std::string> residuals;  ///< which are shown; none: all
  std::string claim;                   ///< what the publication says of it
  std::string truth;                   ///< what is true
};

struct FigureList {
  std::string title, introduction;
  std::vector<Figure> figures;
};

/// Reads a figures file: `title`, `introduction`, and [[figure]] with `title`, `log`, `claim`,
/// `truth`, optional `residuals`. Strict.
/// @throws InputError anything wrong in it; std::system_error it cannot be read.
[[nodiscard]] FigureList read_figures(const std::filesystem::path& file);

/// One page with all of them: timeline and residuals of each run, claim and truth beside them.
/// @param folder where the logs are
/// @throws as read_run_record.
[[nodiscard]] std::string figure_page(const FigureList& list, const std::filesystem::path& folder,
                                      const std::string& version);

}  // namespace faultline
