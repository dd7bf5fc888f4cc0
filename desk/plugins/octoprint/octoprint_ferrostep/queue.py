"""OctoPrint's queue of files to analyse, with ferrostep's time in place of OctoPrint's."""

from octoprint.filemanager.analysis import AnalysisAborted, GcodeAnalysisQueue

from .estimate import EstimateFailed


class FerrostepQueue(GcodeAnalysisQueue):
    """OctoPrint's own analysis finds sizes and filament, and its time stays where ferrostep has none."""

    def __init__(self, finished_callback, plugin):
        # Has its settings and its log later than OctoPrint makes its queues.
        self._plugin = plugin
        self._estimate = None
        # Starts the thread that calls `_do_analysis`.
        super().__init__(finished_callback)

    def _do_analysis(self, high_priority=False):
        self._aborted = False
        analysis = super()._do_analysis(high_priority=high_priority)
        try:
            time_s = self._time_s(self._current.absolute_path)
        except EstimateFailed as error:
            self._plugin.log.warning("%s: OctoPrint's own time stays: %s", self._current, error)
            return analysis
        self._plugin.log.info("%s: %.0f s; by OctoPrint %s s", self._current, time_s, analysis.get("estimatedPrintTime"))
        return {**analysis, "estimatedPrintTime": time_s}

    def _time_s(self, file):
        self._estimate = self._plugin.estimate(file)
        try:
            if self._aborted:
                # It was ended between OctoPrint's part and this one.
                self._estimate.end()
            return self._estimate.time_s()
        finally:
            self._estimate = None
            if self._aborted:
                raise AnalysisAborted(reenqueue=self._reenqueue)

    def _do_abort(self, reenqueue=True):
        super()._do_abort(reenqueue)
        estimate = self._estimate
        if estimate is not None:
            estimate.end()
