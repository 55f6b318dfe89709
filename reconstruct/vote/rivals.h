#pragma once

#include "alhazen/result.h"
#include "reconstruct/options.h"
#include "reconstruct/run.h"
#include "reconstruct/vote/normal_field.h"
#include "reconstruct/vote/observations.h"
#include "reconstruct/vote/octree.h"
#include "reconstruct/vote/voter.h"

namespace alhazen {

/// Takes back normals whose votes are better explained elsewhere: a pixel sees one surface, but it
/// votes at every point of its line of sight, and where the scan's own symmetry makes such votes
/// agree they would draw the cut out of gaps in what was seen.
///
/// Leaves of at least `min_consistency` claim the pixels that agree there, each pixel for the most
/// consistent leaf on its line. A leaf loses its normal where half of its support comes from pixels
/// that leaves of twice its consistency claim from at least kApart leaves away; the field's
/// `no_surface` then says so, and leaves that it is split into are not voted on.
///
/// REQUIRES: `octree` is uniform, `field` is its field. Fails: cancelled. Reentrant; uses the
/// caller's TBB arena; the result does not depend on the number of threads.
[[nodiscard]] Status remove_rivals(const Observations& observations, const VoteOptions& options,
                                   const Voter& voter, double min_consistency, const Octree& octree,
                                   NormalField& field, const Run& run);

}  // namespace alhazen
