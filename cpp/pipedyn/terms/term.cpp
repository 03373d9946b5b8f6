// SPDX-License-Identifier: MIT
#include "pipedyn/terms/term.hpp"

#include <algorithm>
#include <iterator>
#include <stdexcept>

#include "pipedyn/terms/laws.hpp"

namespace pipedyn {

Term make_term(const std::string& law, double at, const std::vector<double>& numbers) {
  const auto row = std::find(std::begin(Laws::names), std::end(Laws::names), law);
  if (row == std::end(Laws::names)) {
    throw std::invalid_argument("no law of force has the name '" + law + "'");
  }
  Term term{.law = static_cast<int>(row - Laws::names), .at = at};
  if (numbers.size() > std::size(term.numbers)) {
    throw std::invalid_argument("a term must have at most 3 numbers, got " +
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

bool resist(const Terms& terms) {
  return std::any_of(terms.begin(), terms.end(), [](const Term& term) {
    bool resists = false;
    const Station<double> straight{0.0, term.at, 0.0, 1.0, 0.0, 0.0, 0.0};
    Laws::with(term, [&](const auto& law) {
      for (const auto& row : law.slopes(straight).by_velocity) resists |= row[0] != 0.0;
    });
    return resists;
  });
}

}  // namespace pipedyn
