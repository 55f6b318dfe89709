#pragma once

#include <nlohmann/json_fwd.hpp>

#include "alhazen/result.h"
#include "daemon/capture/preview.h"
#include "daemon/jobs/scan_job.h"
#include "daemon/plan/plan.h"

namespace alhazen {

// What the arguments of a submit mean. They are kept with the job, so that a job found after a
// restart is run as it was asked for.
// All fail with invalid where a value has the wrong type: arguments that were checked never do.

/// Of scan.submit and plan.estimate.
[[nodiscard]] Result<ScanRequest> scan_request(const nlohmann::json& args);
/// Of scan.submit and reconstruct.submit; `output` and `threads` are left to the caller.
[[nodiscard]] Result<ReconstructionChoices> reconstruction_choices(const nlohmann::json& args);
/// Of preview.take.
[[nodiscard]] Result<PreviewRequest> preview_request(const nlohmann::json& args);

}  // namespace alhazen
