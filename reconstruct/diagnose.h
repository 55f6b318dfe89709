#pragma once

#include <string>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/mesh_io/mesh.h"
#include "reconstruct/options.h"
#include "reconstruct/run.h"
#include "reconstruct/scan/manifest.h"
#include "reconstruct/vote/observations.h"

namespace alhazen {

/// What is wrong with a rig or its light maps, as far as the votes tell: one sentence a fault,
/// empty where all agree.
///
/// 1. Cameras, displays and stops of which no light map holds a position.
/// 2. On the surface that came out, the hypotheses of each camera, display and stop are held
/// against
///    the normal there. One that hardly ever agrees where the others do is named, and what would
///    mend it: another camera or display with which it was exchanged, a picture or a display that
///    is mirrored or upside down.
/// 3. Where no surface came out, or little of one was measured, the votes of coarse leaves are
/// asked
///    how well they agree under other rigs: the turntable turning the other way, everything
///    mirrored, displays mirrored, upside down or exchanged, cameras exchanged. One under which
///    they agree clearly better is named.
/// A good scan pays for 1 and the first look of 2 only: a few hundred points.
///
/// `mesh`: null where there is none. `observations` are as before afterwards.
/// Fails: cancelled. Uses the caller's TBB arena; the result does not depend on the number of
/// threads.
[[nodiscard]] Result<std::vector<std::string>> diagnose(Observations& observations,
                                                        const VoteOptions& options,
                                                        const Volume& volume, const Mesh* mesh,
                                                        const Run& run);

}  // namespace alhazen
