# Writes a C++ file that holds the assets of the page as raw string literals.
#   cmake -DOUT=.. -DDYGRAPH_JS=.. -DDYGRAPH_CSS=.. -DREPORT_JS=.. -DREPORT_CSS=.. -P embed_assets.cmake
set(text "#include \"tools/report/page_assets.h\"\n\nnamespace faultline {\nnamespace {\n\n")
foreach(asset DYGRAPH_JS DYGRAPH_CSS REPORT_JS REPORT_CSS)
  file(READ "${${asset}}" content)
  if(content MATCHES "</[sS][cC][rR][iI][pP][tT]" OR content MATCHES "\\)asset\"")
    message(FATAL_ERROR "${${asset}} cannot stand in a page: it ends the script or its literal")
  endif()
  # A map of sources is a second file, which a page that stands alone does not have.
  string(REGEX REPLACE "/[/*][#@] sourceMappingURL=[^\n]*" "" content "${content}")
  string(APPEND text "constexpr std::string_view k_${asset} = R\"asset(${content})asset\";\n")
endforeach()
string(APPEND text "\n}  // namespace\n\nconst PageAssets& page_assets() noexcept {\n"
  "  static constexpr PageAssets kAssets{k_DYGRAPH_JS, k_DYGRAPH_CSS, k_REPORT_JS, k_REPORT_CSS};\n"
  "  return kAssets;\n}\n\n}  // namespace faultline\n")
file(WRITE "${OUT}" "${text}")
