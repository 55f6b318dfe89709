// Any bytes as a request: the envelope, then the arguments of its verb. What is accepted must be
// accepted again after it was written out, and every refusal must name something.
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <variant>

#include "alhazen/check.h"
#include "daemon/control/message.h"
#include "daemon/control/verbs.h"
#include "daemon/jobs/job.h"
#include "daemon/jobs/requests.h"

extern "C" int LLVMFuzzerTestOneInput(const unsigned char* data, std::size_t size) {
  using namespace alhazen;
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  // The same bytes may stand in a job.json of a scan directory.
  if (const auto job = parse_job(bytes)) {
    const std::string text = dump(to_json(*job));
    const auto again = parse_job(text);
    ALHAZEN_CHECK(again && dump(to_json(*again)) == text);
  }
  const auto parsed = parse_request(bytes);
  if (const auto* refusal = std::get_if<Refusal>(&parsed)) {
    ALHAZEN_CHECK(refusal->error.code == Code::invalid && !refusal->error.what.empty());
    const std::string reply = refusal_text(refusal->id, refusal->error, nlohmann::json::object());
    ALHAZEN_CHECK(nlohmann::json::accept(reply));
    return 0;
  }
  const Request& request = std::get<Request>(parsed);
  ALHAZEN_CHECK(std::holds_alternative<Request>(parse_request(to_text(request))));
  const Verb* verb = find_verb(request.verb);
  if (verb == nullptr) return 0;
  const auto args = check_arguments(verb->arguments, *request.args, "args");
  if (!args) {
    ALHAZEN_CHECK(args.error().code == Code::invalid);
    ALHAZEN_CHECK(
        nlohmann::json::accept(refusal_text(request.id, args.error(), nlohmann::json::object())));
    return 0;
  }
  // Defaults are filled in: checking once more changes nothing.
  const auto again = check_arguments(verb->arguments, *args, "args");
  ALHAZEN_CHECK(again && *again == *args);
  // Checked arguments never have the wrong type for what is made of them.
  if (verb->name == "scan.submit" || verb->name == "plan.estimate")
    ALHAZEN_CHECK(static_cast<bool>(scan_request(*args)));
  if (verb->name == "preview.take") ALHAZEN_CHECK(static_cast<bool>(preview_request(*args)));
  if (verb->name == "scan.submit" || verb->name == "reconstruct.submit")
    ALHAZEN_CHECK(static_cast<bool>(reconstruction_choices(*args)));
  return 0;
}
