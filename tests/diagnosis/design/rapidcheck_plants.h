#pragma once

#include <ostream>
#include <vector>

#include <rapidcheck.h>

#include "tests/support/random_plant.h"

namespace faultline {

/// How rapidcheck shows a plant that breaks a property.
inline void showValue(const PlantRecipe& recipe, std::ostream& out) { out << recipe; }

/// Recipes of the given kinds with 1 .. largest_n states and at least a quarter as many outputs.
inline rc::Gen<PlantRecipe> recipes(std::vector<PlantKind> kinds, Eigen::Index largest_n) {
  return rc::gen::exec([kinds = std::move(kinds), largest_n] {
    PlantRecipe recipe;
    recipe.kind = *rc::gen::elementOf(kinds);
    recipe.n = *rc::gen::inRange<Eigen::Index>(1, largest_n + 1);
    recipe.m = *rc::gen::inRange<Eigen::Index>(2, 5);
    recipe.q = *rc::gen::inRange<Eigen::Index>((recipe.n + 3) / 4,
                                               std::min<Eigen::Index>(recipe.n, 10) + 1);
    recipe.seed = *rc::gen::inRange<std::uint64_t>(0, 1000000);
    return recipe;
  });
}

inline rc::Gen<PlantRecipe> recipes(Eigen::Index largest_n) {
  return recipes(plant_kinds(), largest_n);
}

}  // namespace faultline
