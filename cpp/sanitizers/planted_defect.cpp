// Two defects on purpose. The sanitizer build must catch them: if it does not, it would catch nothing.

#include <cstdlib>
#include <limits>
#include <string>
#include <vector>

int main(int count, char** words) {
  const std::string which = count > 1 ? words[1] : "";
  if (which == "address") {
    // One beyond the end. The index comes from outside, so that no compiler sees it.
    const std::vector<int> four(4, 1);
    return four.data()[count + 2];
  }
  if (which == "undefined") {
    int most = std::numeric_limits<int>::max();
    most += count;
    return most == 0 ? EXIT_FAILURE : EXIT_SUCCESS;
  }
  return EXIT_FAILURE;
}
