// SPDX-License-Identifier: MIT
#include "pipedyn/terms/term.hpp"

#include <algorithm>
#include <iterator>
#include <optional>
#include <stdexcept>

#include "pipedyn/pipe.hpp"
#include "pipedyn/terms/laws.hpp"

namespace pipedyn {

Term make_term(const std::string& law, double at, const std::vector<double>& numbers) {
  const auto row = std::find(std::begin(Laws::names), std::end(Laws::names), law);
  if (row == std::end(Laws::names)) {
    throw std::invalid_argument("no law of force has the name '" + law + "'");
  }
  Term term{.law = static_cast<int>(row - Laws::names), .at = at};
  if (numbers.size() > std::size(term.numbers)) {
    throw std::invalid_argument("a term must have at most 9 numbers, got " +
                                std::to_string(numbers.size()));
  }
  std::copy(numbers.begin(), numbers.end(), term.numbers);
  Laws::with(term, [&](const auto& which) {
    if (!which.along && !(at > 0.0 && at <= 1.0)) {
      throw std::invalid_argument("at must lie in (0, 1], got " + std::to_string(at));
    }
  });
  return term;
}

namespace {

/// Load and slopes of a term at its place on the straight pipe.
AtRest at_rest(const Term& term) {
  std::optional<AtRest> found;
  Laws::with(term, [&](const auto& law) { found.emplace(law, term.at); });
  return *found;
}

bool any_slope(const AtRest& of, const int (&variables)[2]) {
  bool any = false;
  for (const int row : small_rows) {
    for (const int k : variables) any = any || of.slopes.by[row][k] != 0.0;
  }
  return any;
}

}  // namespace

bool resist(const Terms& terms) {
  return std::any_of(terms.begin(), terms.end(),
                     [](const Term& term) { return any_slope(at_rest(term), small_moving); });
}

std::array<double, 2> added_stiffness(const Terms& terms) {
  std::array<double, 2> sum{};
  for (const Term& term : terms) {
    const Slopes<double> slopes = at_rest(term).slopes;
    sum[0] += std::max(-slopes.by[0][by_position], 0.0);
    sum[1] += std::max(-slopes.by[2][by_angle], 0.0);
  }
  return sum;
}

bool is_felt_by_small_motions(const std::string& law) {
  const Term one = make_term(law, 1.0, std::vector<double>(std::size(Term().numbers), 1.0));
  const AtRest acting = at_rest(one);
  bool has_inertia = false;
  Laws::with(one, [&](const auto& of) {
    has_inertia = of.mass() + of.inertia() + of.normal_mass() != 0.0;
  });
  return has_inertia || acting.load.y != 0.0 || any_slope(acting, small_still) ||
         any_slope(acting, small_moving);
}

void require_space(const Pipe& pipe) {
  const auto refuse = [](const std::string& what) {
    throw std::invalid_argument("a pipe " + what + " has no equations in three dimensions here");
  };
  for (const Term& term : pipe.terms) {
    Laws::with(term, [&]<class Law>(const Law& law) {
      const bool known = law.applied || !Law::moves || states_space<Law>;
      if (!known) refuse(std::string("with ") + law.name);
    });
  }
}

}  // namespace pipedyn
