//! The safe side of the bridge: a collision scene and the search in it.

use crate::bridge::{ffi, pose_row, shape_row};
use crate::error::{PlanningError, check_vector};
use crate::search::{BaselineOutcome, CancelFlag, MeshObstacle, Roadmap, SearchOutcome, SearchStats};
use crate::state_check::StateCheck;
use crate::{PlannerName, SearchLimits};
use proact_arm::{ArmModel, JointKind};
use proact_types::{AttachedObject, Obstacle, Pose};
use std::collections::BTreeMap;

/// A planner as OMPL sets it up.
const NO_PARAMETERS: BTreeMap<String, String> = BTreeMap::new();

/// An arm among obstacles: FCL tells what touches, OMPL finds paths.
///
/// Poses are in `world`, metres and radians. Links that keep still against each other during a plan (the links
/// of the hand, and the base) are not compared with each other.
pub struct CollisionScene {
    pub(crate) stats: SearchStats,
    inner: cxx::UniquePtr<ffi::Scene>,
    roadmap: cxx::SharedPtr<ffi::Roadmap>,
    joint_count: usize,
    hand_count: usize,
}

// SAFETY: the C++ object owns everything it points to (FCL geometries sit in shared pointers that never leave
// it), has no thread-local state, and is reached only through `&mut self`; the roadmap is never written after it is
// made, and its count is atomic. `Sync` is not granted: questions
// write to scratch memory.
unsafe impl Send for CollisionScene {}

impl CollisionScene {
    /// A scene with nothing but the arm, its base at the origin of `world` and its hand at all zeros.
    ///
    /// # Errors
    /// [`PlanningError::Scene`] if the model has a shape without extent, limits in the wrong order, a joint
    /// without axis or an arm group that is no unbroken chain.
    pub fn new(model: &ArmModel) -> Result<Self, PlanningError> {
        let mut arm = ffi::new_arm();
        for link in &model.links {
            let shapes: Vec<_> = link.collisions.iter().map(|c| shape_row(&c.shape, &c.pose)).collect();
            ffi::add_link(arm.pin_mut(), &link.name, &shapes)?;
        }
        for joint in &model.joints {
            let row = ffi::JointRow {
                parent: joint.parent,
                child: joint.child,
                kind: match joint.kind {
                    JointKind::Fixed => ffi::JointKind::Fixed,
                    JointKind::Revolute | JointKind::Continuous => ffi::JointKind::Revolute,
                    JointKind::Prismatic => ffi::JointKind::Prismatic,
                },
                pose: pose_row(&joint.origin),
                axis: joint.axis.into(),
                lower: joint.limits.lower,
                upper: joint.limits.upper,
            };
            ffi::add_joint(arm.pin_mut(), &row)?;
        }
        ffi::set_groups(arm.pin_mut(), &model.arm, &model.hand, model.tip)?;
        for &(a, b) in &model.allowed_collisions {
            ffi::allow_pair(arm.pin_mut(), a, b)?;
        }
        let inner = ffi::new_scene(&arm)?;
        Ok(Self {
            stats: SearchStats::default(),
            inner,
            roadmap: cxx::SharedPtr::null(),
            joint_count: model.arm.len(),
            hand_count: model.hand.len(),
        })
    }

    /// Number of arm joints.
    pub fn joint_count(&self) -> usize {
        self.joint_count
    }

    /// Sets `world_from_base`.
    ///
    /// # Errors
    /// A component that is not finite.
    pub fn set_base(&mut self, world_from_base: &Pose) -> Result<(), PlanningError> {
        let row = pose_row(world_from_base);
        check_vector("base pose", &row, row.len())?;
        Ok(ffi::set_base(self.inner.pin_mut(), &row)?)
    }

    /// Sets the hand's joint angles, rad.
    ///
    /// # Errors
    /// Wrong length or a value that is not finite.
    pub fn set_hand(&mut self, angles: &[f64]) -> Result<(), PlanningError> {
        check_vector("hand", angles, self.hand_count)?;
        Ok(ffi::set_hand(self.inner.pin_mut(), angles)?)
    }

    /// Replaces all obstacles and withdraws the allowed contacts.
    ///
    /// # Errors
    /// [`PlanningError::Scene`] naming the obstacle that has no extent, no proper pose or another one's name;
    /// the scene then keeps its old obstacles.
    pub fn set_obstacles(&mut self, obstacles: &[Obstacle]) -> Result<(), PlanningError> {
        self.set_obstacles_and_meshes(obstacles, &[])
    }

    /// As [`CollisionScene::set_obstacles`], with meshes among them. A mesh's surface collides, padding included;
    /// what is wholly inside one does not touch it. Negative padding does not shrink it.
    ///
    /// # Errors
    /// As there, and for a mesh without triangles, a vertex that is not finite, or a triangle that names no vertex.
    pub fn set_obstacles_and_meshes(
        &mut self,
        obstacles: &[Obstacle],
        meshes: &[MeshObstacle],
    ) -> Result<(), PlanningError> {
        let meshes: Vec<_> = meshes
            .iter()
            .map(|mesh| ffi::MeshRow {
                name: mesh.name.clone(),
                vertices: mesh.vertices.as_flattened().to_vec(),
                triangles: mesh.triangles.as_flattened().to_vec(),
                pose: pose_row(&mesh.pose),
            })
            .collect();
        let names: Vec<String> = obstacles.iter().map(|o| o.name.clone()).collect();
        let shapes: Vec<_> = obstacles.iter().map(|o| shape_row(&o.shape, &o.pose)).collect();
        Ok(ffi::set_obstacles(self.inner.pin_mut(), &names, &shapes, &meshes)?)
    }

    /// Replaces what the hand carries.
    ///
    /// # Errors
    /// [`PlanningError::Scene`] if it has no extent or no proper pose.
    pub fn set_attached(&mut self, attached: Option<&AttachedObject>) -> Result<(), PlanningError> {
        match attached {
            Some(object) => Ok(ffi::set_attached(
                self.inner.pin_mut(),
                &object.name,
                &shape_row(&object.shape, &object.tip_from_object),
            )?),
            None => Ok(ffi::clear_attached(self.inner.pin_mut())?),
        }
    }

    /// Grows every obstacle by `meters` on all sides; a negative number shrinks it.
    ///
    /// # Errors
    /// A number that is not finite.
    pub fn set_padding(&mut self, meters: f64) -> Result<(), PlanningError> {
        check_vector("padding", &[meters], 1)?;
        Ok(ffi::set_padding(self.inner.pin_mut(), meters)?)
    }

    /// From now on `member` (a link or the carried object) may touch `obstacle`.
    ///
    /// # Errors
    /// [`PlanningError::Scene`] for a name that does not exist.
    pub fn allow_contact(&mut self, member: &str, obstacle: &str) -> Result<(), PlanningError> {
        Ok(ffi::allow_contact(self.inner.pin_mut(), member, obstacle)?)
    }

    /// Withdraws everything allowed with [`CollisionScene::allow_contact`].
    ///
    /// # Errors
    /// None at present; the bridge could run out of memory.
    pub fn clear_allowed_contacts(&mut self) -> Result<(), PlanningError> {
        Ok(ffi::clear_allowed_contacts(self.inner.pin_mut())?)
    }

    /// Names of the pairs that touch at the arm angles `q`.
    ///
    /// # Errors
    /// Wrong length or a value that is not finite.
    pub fn collisions(&mut self, q: &[f64]) -> Result<Vec<(String, String)>, PlanningError> {
        self.contacts(q, false)
    }

    /// As [`CollisionScene::collisions`], and also pairs of links that keep still against each other, such as
    /// two fingers.
    ///
    /// # Errors
    /// Wrong length or a value that is not finite.
    pub fn collisions_of_all_links(&mut self, q: &[f64]) -> Result<Vec<(String, String)>, PlanningError> {
        self.contacts(q, true)
    }

    fn contacts(&mut self, q: &[f64], all_links: bool) -> Result<Vec<(String, String)>, PlanningError> {
        check_vector("arm angles", q, self.joint_count)?;
        let rows = ffi::collisions(self.inner.pin_mut(), q, all_links)?;
        Ok(rows.into_iter().map(|row| (row.a, row.b)).collect())
    }

    /// True if nothing touches at the arm angles `q`.
    ///
    /// # Errors
    /// Wrong length or a value that is not finite.
    pub fn is_free(&mut self, q: &[f64]) -> Result<bool, PlanningError> {
        check_vector("arm angles", q, self.joint_count)?;
        Ok(ffi::is_free(self.inner.pin_mut(), q)?)
    }

    /// True if nothing touches on the straight joint motion from `a` to `b`, ends included.
    ///
    /// # Errors
    /// Wrong length or a value that is not finite.
    pub fn motion_is_free(
        &mut self,
        a: &[f64],
        b: &[f64],
        limits: &SearchLimits,
    ) -> Result<bool, PlanningError> {
        check_vector("arm angles", a, self.joint_count)?;
        check_vector("arm angles", b, self.joint_count)?;
        let row = search_row(PlannerName::default(), &NO_PARAMETERS, 0, limits);
        Ok(ffi::motion_is_free(self.inner.pin_mut(), a, b, &row)?)
    }

    /// True if nothing touches on the straight joint motions that join `states`, one after the other, states included.
    ///
    /// # Errors
    /// Wrong length or a value that is not finite.
    pub fn path_is_free<'a>(
        &mut self,
        states: impl IntoIterator<Item = &'a [f64]>,
        limits: &SearchLimits,
    ) -> Result<bool, PlanningError> {
        let flat = self.flatten_states(states)?;
        let row = search_row(PlannerName::default(), &NO_PARAMETERS, 0, limits);
        Ok(ffi::path_is_free(self.inner.pin_mut(), &flat, &row)?)
    }

    /// True if [`CollisionScene::is_free`] holds for each of `states`, which lie close to their neighbours: then one
    /// question settles many.
    ///
    /// # Errors
    /// Wrong length or a value that is not finite.
    pub fn states_are_free<'a>(
        &mut self,
        states: impl IntoIterator<Item = &'a [f64]>,
    ) -> Result<bool, PlanningError> {
        let flat = self.flatten_states(states)?;
        Ok(ffi::states_are_free(self.inner.pin_mut(), &flat)?)
    }

    fn flatten_states<'a>(
        &self,
        states: impl IntoIterator<Item = &'a [f64]>,
    ) -> Result<Vec<f64>, PlanningError> {
        let mut flat = Vec::new();
        for state in states {
            check_vector("arm angles", state, self.joint_count)?;
            flat.extend_from_slice(state);
        }
        Ok(flat)
    }

    /// A free path from `start` to one of `goals` by RRTConnect. Equal scenes, vectors and seeds give equal
    /// outcomes, whatever runs in other threads.
    ///
    /// # Errors
    /// Wrong lengths, values that are not finite or outside the joint limits, no goal.
    pub fn search(
        &mut self,
        start: &[f64],
        goals: &[Vec<f64>],
        seed: u64,
        limits: &SearchLimits,
        cancel: &CancelFlag,
    ) -> Result<SearchOutcome, PlanningError> {
        self.search_with(PlannerName::default(), &NO_PARAMETERS, start, goals, seed, limits, cancel)
    }

    /// As [`CollisionScene::search`], by any planner. `parameters` are values as text by OMPL's names, such as
    /// `goal_bias`.
    ///
    /// Planners other than RRTConnect draw from generators that the whole process shares: such a search waits
    /// until it is the only one.
    ///
    /// # Errors
    /// As for [`CollisionScene::search`], and a parameter that the planner does not know or refuses.
    #[allow(clippy::too_many_arguments)]
    pub fn search_with(
        &mut self,
        planner: PlannerName,
        parameters: &BTreeMap<String, String>,
        start: &[f64],
        goals: &[Vec<f64>],
        seed: u64,
        limits: &SearchLimits,
        cancel: &CancelFlag,
    ) -> Result<SearchOutcome, PlanningError> {
        check_vector("start", start, self.joint_count)?;
        for goal in goals {
            check_vector("goal", goal, self.joint_count)?;
        }
        let flat: Vec<f64> = goals.iter().flatten().copied().collect();
        let search = search_row(planner, parameters, seed, limits);
        let row = ffi::plan_joint(self.inner.pin_mut(), start, &flat, &search, &self.roadmap, &cancel.0)?;
        self.outcome(row)
    }

    /// Grows a roadmap of so many milestones among what stands in the scene now, by OMPL's PRM. Equal scenes and seeds
    /// give equal roadmaps; fewer milestones if the flag was raised.
    ///
    /// # Errors
    /// Limits that make no sense.
    pub fn grow_roadmap(
        &mut self,
        milestones: usize,
        seed: u64,
        limits: &SearchLimits,
        cancel: &CancelFlag,
    ) -> Result<Roadmap, PlanningError> {
        let search = search_row(PlannerName::Prm, &NO_PARAMETERS, seed, limits);
        let row = ffi::grow_roadmap(self.inner.pin_mut(), &search, milestones, &cancel.0)?;
        Ok(Roadmap {
            milestones: row.milestones.chunks_exact(self.joint_count).map(<[f64]>::to_vec).collect(),
            edges: row.edges.as_chunks().0.to_vec(),
        })
    }

    /// What searches by PRM begin with from now on; none for a roadmap of their own each.
    ///
    /// # Errors
    /// A milestone of another length or that is not finite, an edge that names no milestone.
    pub fn set_roadmap(&mut self, roadmap: Option<&Roadmap>) -> Result<(), PlanningError> {
        let Some(roadmap) = roadmap else {
            self.roadmap = cxx::SharedPtr::null();
            return Ok(());
        };
        for milestone in &roadmap.milestones {
            check_vector("a milestone of the roadmap", milestone, self.joint_count)?;
        }
        let count = roadmap.milestones.len();
        if let Some(edge) = roadmap.edges.iter().find(|edge| edge[0].max(edge[1]) >= count) {
            return Err(PlanningError::Scene(format!(
                "the roadmap's edge {edge:?} names no milestone of its {count}"
            )));
        }
        let row = ffi::RoadmapRow {
            milestones: roadmap.milestones.concat(),
            edges: roadmap.edges.as_flattened().to_vec(),
        };
        self.roadmap = ffi::new_roadmap(&row, self.joint_count);
        Ok(())
    }

    /// As [`CollisionScene::search`], among those arm angles alone that `accepts` says yes to. Every state is asked
    /// about across the language boundary, in steps of the limits' resolution: for conditions of one's own, at a
    /// price that `proact bench planning` tells.
    ///
    /// # Errors
    /// As for [`CollisionScene::search`]; [`PlanningError::Scene`] with the message if `accepts` panicked.
    pub fn search_constrained(
        &mut self,
        start: &[f64],
        goals: &[Vec<f64>],
        seed: u64,
        limits: &SearchLimits,
        cancel: &CancelFlag,
        accepts: &mut dyn FnMut(&[f64]) -> bool,
    ) -> Result<SearchOutcome, PlanningError> {
        check_vector("start", start, self.joint_count)?;
        for goal in goals {
            check_vector("goal", goal, self.joint_count)?;
        }
        let flat: Vec<f64> = goals.iter().flatten().copied().collect();
        let search = search_row(PlannerName::default(), &NO_PARAMETERS, seed, limits);
        let mut condition = StateCheck::new(accepts);
        let scene = self.inner.pin_mut();
        let row = ffi::plan_joint_constrained(scene, start, &flat, &search, &mut condition, &cancel.0)?;
        match condition.panicked() {
            Some(text) => Err(PlanningError::Scene(format!("the condition panicked: {text}"))),
            None => self.outcome(row),
        }
    }

    /// Of `states`, one row of arm angles each, how many are free: a loop in C++, for measuring it.
    ///
    /// # Errors
    /// A length that is no multiple of the joints, a value that is not finite.
    pub fn count_free(&mut self, states: &[f64]) -> Result<usize, PlanningError> {
        check_vector("states", states, states.len() - states.len() % self.joint_count)?;
        Ok(ffi::count_free(self.inner.pin_mut(), states)?)
    }

    /// Of `states`, how many `accepts` says yes to: a loop in C++ that calls back, for measuring the price.
    ///
    /// # Errors
    /// As for [`CollisionScene::count_free`].
    pub fn count_accepted(
        &self,
        states: &[f64],
        accepts: &mut dyn FnMut(&[f64]) -> bool,
    ) -> Result<usize, PlanningError> {
        check_vector("states", states, states.len() - states.len() % self.joint_count)?;
        Ok(ffi::count_accepted(states, self.joint_count, &mut StateCheck::new(accepts))?)
    }

    fn outcome(&mut self, row: ffi::PlanRow) -> Result<SearchOutcome, PlanningError> {
        self.stats.iterations += row.iterations;
        self.stats.state_checks += row.state_checks;
        self.stats.search_secs += row.seconds;
        self.stats.timed_out |= row.timed_out;
        match row.status {
            ffi::JointPlanStatus::Solved => Ok(SearchOutcome::Solved {
                path: row.path.chunks_exact(self.joint_count).map(<[f64]>::to_vec).collect(),
                goal: row.goal,
            }),
            ffi::JointPlanStatus::NoPlan => Ok(SearchOutcome::NoPlan),
            ffi::JointPlanStatus::StartInCollision => Ok(SearchOutcome::StartInCollision),
            ffi::JointPlanStatus::GoalsInCollision => Ok(SearchOutcome::GoalsInCollision),
            ffi::JointPlanStatus::Cancelled => Ok(SearchOutcome::Cancelled),
            other => Err(PlanningError::Scene(format!("unknown plan status {other:?}"))),
        }
    }

    /// The same search as a plain C++ program on OMPL and FCL does it: states every `equal_steps` of the joint space's
    /// extent (the original's are 0.005), FCL's dynamic trees, up to eight attempts of `attempt_secs` of processor time.
    /// The peer of the benchmark; not repeatable. Contacts allowed one by one are not known to it.
    ///
    /// # Errors
    /// Wrong lengths, values that are not finite or outside the joint limits, no goal.
    pub fn search_baseline(
        &mut self,
        start: &[f64],
        goals: &[Vec<f64>],
        planner: PlannerName,
        attempt_secs: f64,
        equal_steps: f64,
        seed: u64,
    ) -> Result<BaselineOutcome, PlanningError> {
        check_vector("start", start, self.joint_count)?;
        for goal in goals {
            check_vector("goal", goal, self.joint_count)?;
        }
        let flat: Vec<f64> = goals.iter().flatten().copied().collect();
        let row = {
            let limits = SearchLimits {
                max_secs: Some(attempt_secs),
                fixed_validity_step: Some(equal_steps),
                ..SearchLimits::default()
            };
            ffi::search_baseline(
                &self.inner,
                start,
                &flat,
                &search_row(planner, &NO_PARAMETERS, seed, &limits),
            )?
        };
        Ok(BaselineOutcome {
            path: row.path.chunks_exact(self.joint_count).map(<[f64]>::to_vec).collect(),
            attempts: row.attempts,
            search_secs: row.search_secs,
            cpu_secs: row.cpu_secs,
        })
    }
}

/// Refuses a parameter that the planner does not know, naming those that it does, or a value that it refuses.
pub(crate) fn check_planner(
    planner: PlannerName,
    parameters: &BTreeMap<String, String>,
) -> Result<(), PlanningError> {
    Ok(ffi::check_planner(&search_row(planner, parameters, 0, &SearchLimits::default()))?)
}

fn search_row(
    planner: PlannerName,
    parameters: &BTreeMap<String, String>,
    seed: u64,
    limits: &SearchLimits,
) -> ffi::SearchRow {
    ffi::SearchRow {
        seed,
        planner: match planner {
            PlannerName::RrtConnect => ffi::PlannerKind::RrtConnect,
            PlannerName::BiTrrt => ffi::PlannerKind::BiTrrt,
            PlannerName::LbKpiece1 => ffi::PlannerKind::LbKpiece1,
            PlannerName::RrtStar => ffi::PlannerKind::RrtStar,
            PlannerName::Prm => ffi::PlannerKind::Prm,
            PlannerName::AnytimePathShortening => ffi::PlannerKind::Anytime,
        },
        parameters: parameters.iter().flat_map(|(name, value)| [name.clone(), value.clone()]).collect(),
        equal_steps: limits.fixed_validity_step.unwrap_or(0.0),
        max_iterations: limits.max_iterations,
        max_seconds: limits.max_secs.unwrap_or(0.0),
        more_searches: limits.more_searches,
        range: limits.range_rad,
        shortcut_attempts: limits.shortcut_attempts,
        step_rad: limits.step_rad,
        step_m: limits.step_m,
    }
}
